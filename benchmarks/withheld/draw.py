"""One case: a bench with parameter errors and effects, its logs, the nominal model for the tool, and the true causes.

A cause is whatever alone, added to the nominal model and driven by the same current, changes one of the four signals by
the threshold or more. The key is computed from this after the log is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from cause import Bench, Conditions, Effect
from effect_gap import COARSE, THRESHOLD, UNCERTAIN, EffectGap, drive_command, simulated_signals
from effects_sensor import sensor_filter
from family import FAMILIES, RIG_FAMILIES, consistent, intended_effects
from gap import gap, largest, noise_of, of_samples
from key import beside_the_others, held_out, key, measured
from nominal_rig import draw_nominal_rig, parameter_errors, set_options
from operation import Operation, usable
from plant import simulate
from rig import Rig
from sensors import LOGGER_FAMILIES, NOISE, Sensors

#: The true bench, driven by the logged current, leaves at most this share of the threshold, or of the gap.
REPEATABLE = (0.5, 0.25)
#: First word of the seeds, so that the two sets share no random stream.
SETS = {"tuning": 20_251, "reported": 90_017}
ATTEMPTS = 150
SAMPLES, SAMPLES_VALIDATE = 6000, 4000


class NoDrawError(Exception):
    """No draw of a case was usable."""


@dataclass(frozen=True)
class Case:
    log: dict[str, np.ndarray]
    validate: dict[str, np.ndarray] | None
    model_settings: dict[str, Any]
    key: dict[str, Any]


def draw(set_name: str, family: str, index: int) -> Case:
    """The case of that seed. Inconsistent draws and draws outside the rig's limits are rejected and repeated."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([SETS[set_name], FAMILIES.index(family), index, attempt])
        case = _attempt(rng, family, index, attempt)
        if case is not None:
            return case
    raise NoDrawError(f"{set_name} {family} {index}: none of {ATTEMPTS} draws was usable")


def _attempt(rng: np.random.Generator, family: str, index: int, attempt: int) -> Case | None:
    nominal_rig = draw_nominal_rig(rng, family, index)
    sensors = Sensors()
    if family in LOGGER_FAMILIES:
        sensors = Sensors.of_a_logger(rng)
    elif rng.random() < 0.4:
        sensors = Sensors(noise={name: sd * rng.uniform(0.5, 1.5) for name, sd in NOISE.items()})
    load_cell = bool(rng.random() < 0.75) and family not in LOGGER_FAMILIES
    operation = Operation.draw(rng, family, SAMPLES, nominal_rig.K_S > 0.0, sensors.step["position"])
    lead = operation.lead

    # Sizes and errors are determined with the current of a rehearsal, as the true log does not exist yet. The
    # linear set has no friction that would stop the rod, so its rehearsal uses the nonlinear set.
    rehearsal = operation.run(Bench(Rig(K_S=nominal_rig.K_S) if family == "linear" else nominal_rig), sensors, rng)
    if not usable(rehearsal):
        return None
    effect_gap = EffectGap(nominal_rig, rehearsal.current[lead:], rehearsal.current[:lead])
    conditions = Conditions(rng, rehearsal.samples, nominal_rig.K_S)
    filters = [effect_gap.of_effect(*each) for each in _sensor_filters(rng)] if family in LOGGER_FAMILIES else []
    chosen = [
        effect_gap.scaled_to(effect, target) for effect, target in intended_effects(family, index, attempt, conditions)
    ]
    bench = Bench(nominal_rig, sensors)
    for cause in (*filters, *chosen):
        bench = cause.effect.apply(bench, cause.size)
    touched = {name for name in UNCERTAIN if getattr(bench.rig, name) != getattr(nominal_rig, name)}
    errors = parameter_errors(rng, family, attempt, effect_gap, touched)
    bench = bench.with_rig(**{name: getattr(bench.rig, name) * (1.0 + e) for name, e in errors.items()})

    whole = operation.run(bench, sensors, rng)
    if not usable(whole):
        return None
    run, before = whole.after(lead), whole.current[:lead]
    log = bench.sensors.log(run, rng, force=load_cell)
    floor = noise_of(sensors.noise, sensors.step)
    start = run.states[0] if lead else None
    nominal = of_samples(simulate(nominal_rig, log["current"], start=start, steps=COARSE).samples)
    total = gap(measured(log), nominal, floor)
    outside = family in ("outside", "outside_rig")
    scale, bias = bench.sensors.scale.get("current", 1.0), bench.sensors.bias.get("current", 0.0)
    effect_gap = EffectGap(nominal_rig, run.current * scale + bias, before * scale + bias)
    causes = [effect_gap.of_effect(c.effect, c.size) for c in chosen]
    if family not in ("parameters", "nominals_off") and not consistent(family, causes, (), total):
        return None
    # Reject a log in which the noise of the logged current decides where the rod sticks: it tells little about causes.
    truth = gap(measured(log), simulated_signals(bench, drive_command(bench, log["current"]), lead=before), floor)
    if not outside and not _repeatable(truth, total):
        return None
    minor = [effect_gap.of_parameter_error(name, e) for name, e in errors.items()]
    minor += [effect_gap.of_effect(c.effect, c.size) for c in filters]
    if not consistent(family, causes, minor, total):
        return None
    causes += minor

    validate = None
    if family not in RIG_FAMILIES and rng.random() < 0.5:
        other = Operation.draw(rng, family if family in ("closed_loop", "weak") else "single", SAMPLES_VALIDATE)
        second = other.run(bench, sensors, rng)
        if not usable(second):
            return None
        validate = bench.sensors.log(second, rng, force=load_cell)
        held_out_gap = held_out(nominal_rig, bench, causes, second, validate, floor, whole=True)
        if not outside and not _repeatable(held_out_gap["gap"]["truth"], held_out_gap["gap"]["nominal"]):
            return None
    else:
        held_out_gap = held_out(nominal_rig, bench, causes, run, log, floor, whole=False, lead=before)
    model_settings = {
        "plant": "ehsa",
        "model": "linear" if family == "linear" else "nonlinear",
        "spring_stiffness": nominal_rig.K_S,
        "set": set_options(nominal_rig, family),
    }
    beside = beside_the_others(Bench(nominal_rig, sensors), causes, log["current"], before)
    found = key(family, operation, load_cell, bench, causes, beside, errors, total, held_out_gap)
    return Case(log, validate, model_settings, found)


def _sensor_filters(rng: np.random.Generator) -> list[tuple[Effect, float]]:
    """Analogue filters of a rig's logger: too fast to matter, but real."""
    lags = {"speed": rng.uniform(4e-4, 8e-4), "p1": (p := rng.uniform(4e-4, 1e-3)), "p2": p}
    return [(sensor_filter(channel), float(lag)) for channel, lag in lags.items()]


def _repeatable(truth: Mapping[str, float], nominal: Mapping[str, float]) -> bool:
    return largest(truth) <= max(REPEATABLE[0] * THRESHOLD, REPEATABLE[1] * largest(nominal))
