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
from effect_gap import COARSE, THRESHOLD, UNCERTAIN, Cause, EffectGap, drive_command, simulated_signals
from effects import CONTRACT, IDS
from effects import draw as draw_effect
from effects_outside import LAWS, OUTSIDE, draw_outside
from gap import gap, largest, noise_of, of_samples
from key import held_out, key, measured
from nominal_rig import draw_nominal_rig, parameter_errors, set_options
from operation import Operation, usable
from plant import simulate
from rig import Rig
from sensors import NOISE, POSITION_STEP, Sensors

MARGIN = 0.03  # relative distance from the threshold that every decisive gap must keep
FAMILIES = ("single", "pair", "none", "outside", "weak", "closed_loop", "parameters", "linear")
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
    noise = dict(NOISE)
    if rng.random() < 0.4:
        noise = {name: sd * rng.uniform(0.5, 1.5) for name, sd in NOISE.items()}
    load_cell = bool(rng.random() < 0.75)
    operation = Operation.draw(rng, family, SAMPLES)

    # Sizes and errors are determined with the current of a rehearsal, as the true log does not exist yet. The
    # linear set has no friction that would stop the rod, so its rehearsal uses the nonlinear set.
    rehearsal = operation.run(Bench(Rig(K_S=nominal_rig.K_S) if family == "linear" else nominal_rig), noise, rng)
    if not usable(rehearsal):
        return None
    effect_gap = EffectGap(nominal_rig, rehearsal.current)
    conditions = Conditions(rng, rehearsal.samples, nominal_rig.K_S)
    chosen = [
        effect_gap.scaled_to(effect, target) for effect, target in _intended_effects(family, index, attempt, conditions)
    ]
    bench = Bench(nominal_rig, Sensors(noise=noise))
    for cause in chosen:
        bench = cause.effect.apply(bench, cause.size)
    touched = {name for name in UNCERTAIN if getattr(bench.rig, name) != getattr(nominal_rig, name)}
    errors = parameter_errors(rng, family, attempt, effect_gap, touched)
    bench = bench.with_rig(**{name: getattr(bench.rig, name) * (1.0 + e) for name, e in errors.items()})

    run = operation.run(bench, noise, rng)
    if not usable(run):
        return None
    log = bench.sensors.log(run, rng, force=load_cell)
    floor = noise_of({**noise, "position_step": POSITION_STEP})
    nominal = of_samples(simulate(nominal_rig, log["current"], steps=COARSE).samples)
    total = gap(measured(log), nominal, floor)
    scale, bias = bench.sensors.scale.get("current", 1.0), bench.sensors.bias.get("current", 0.0)
    effect_gap = EffectGap(nominal_rig, run.current * scale + bias)
    causes = [effect_gap.of_effect(c.effect, c.size) for c in chosen]
    if family != "parameters" and not _consistent(family, causes, total):
        return None
    # Reject a log in which the noise of the logged current decides where the rod sticks: it tells little about causes.
    truth = gap(measured(log), simulated_signals(bench, drive_command(bench, log["current"])), floor)
    if family != "outside" and not _repeatable(truth, total):
        return None
    causes += [effect_gap.of_parameter_error(name, e) for name, e in errors.items()]
    if not _consistent(family, causes, total):
        return None

    validate = None
    if rng.random() < 0.5:
        other = Operation.draw(rng, family if family in ("closed_loop", "weak") else "single", SAMPLES_VALIDATE)
        second = other.run(bench, noise, rng)
        if not usable(second):
            return None
        validate = bench.sensors.log(second, rng, force=load_cell)
        held_out_gap = held_out(nominal_rig, bench, causes, second, validate, floor, whole=True)
        if family != "outside" and not _repeatable(held_out_gap["gap"]["truth"], held_out_gap["gap"]["nominal"]):
            return None
    else:
        held_out_gap = held_out(nominal_rig, bench, causes, run, log, floor, whole=False)
    model_settings = {
        "plant": "ehsa",
        "model": "linear" if family == "linear" else "nonlinear",
        "spring_stiffness": nominal_rig.K_S,
        "set": set_options(nominal_rig, family),
    }
    return Case(
        log, validate, model_settings, key(family, operation, load_cell, bench, causes, errors, total, held_out_gap)
    )


def _intended_effects(family: str, index: int, attempt: int, c: Conditions) -> list[tuple[Effect, float]]:
    """Effects to apply and the gap that each is to cause alone, from half of the threshold to twelve times it."""
    rng = c.rng
    ids = [id for id in CONTRACT if c.K_S > 0.0 or id != "backlash"]

    def target(low: float = 0.5, high: float = 12.0) -> float:
        return THRESHOLD * float(np.exp(rng.uniform(np.log(low), np.log(high))))

    match family:
        case "single" | "closed_loop":
            return [(draw_effect(IDS[index % len(IDS)], c), target())]
        case "weak":
            return [(draw_effect(str(rng.choice(ids)), c), target(1.2, 10.0))]
        case "none":
            return [(draw_effect(str(rng.choice(ids)), c), target(0.2, 0.9))] if index % 3 == 0 else []
        case "outside":
            # Every law in turn; one that has no relevant effect on this bench is replaced.
            law = LAWS[index % len(LAWS)] if attempt < 30 else ""
            return [(draw_outside(c, law), target(1.2))]
        case "linear":
            return [(effect, 0.0) for effect in _nonlinear_terms()]
        case "pair":
            a, b = (draw_effect(str(id), c) for id in rng.choice(ids, 2, replace=False))
            pair = [a] if set(a.accepted) & set(b.accepted) else [a, b]
            return [(effect, target(1.2)) for effect in pair]
    return []


def _nonlinear_terms() -> list[Effect]:
    """What the linear model lacks, with the values of the nonlinear one."""
    full = Rig()
    parts = {
        "rod_friction": ("A_FR", "C_FR", "tau_FR"),
        "motor_friction": ("A_FM", "C_FM", "tau_FM"),
        "chamber_volume_variation": ("V_10", "V_20", "stroke_term"),
    }

    def effect(id: str, names: tuple[str, ...]) -> Effect:
        values = {name: getattr(full, name) for name in names}
        return Effect(id, "missing", lambda b, s: b.with_rig(**values), 1.0, 1.0, lambda b: values)

    return [effect(id, names) for id, names in parts.items()]


def _repeatable(truth: Mapping[str, float], nominal: Mapping[str, float]) -> bool:
    return largest(truth) <= max(REPEATABLE[0] * THRESHOLD, REPEATABLE[1] * largest(nominal))


def _consistent(family: str, causes: list[Cause], total: Mapping[str, float]) -> bool:
    """Gap and causes agree, with a margin to the threshold, and the case belongs to its family."""
    decisive = [largest(total), *(largest(c.alone) for c in causes)]
    if any(abs(value / THRESHOLD - 1.0) < MARGIN for value in decisive) or not all(np.isfinite(decisive)):
        return False
    counted = [c for c in causes if c.counts]
    if bool(counted) != (largest(total) >= THRESHOLD):
        return False
    match family:
        case "none":
            return not counted
        case "outside":
            return [c.effect.id for c in counted] == [OUTSIDE]
        case "pair":
            return len(counted) == 2
        case "weak":
            return len(counted) == 1
        case "parameters" | "linear":
            return 1 <= len(counted) <= 3
    return len(counted) <= 1
