"""Candidate effects: the effects that can act in this plant and show in this log, with their free parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.log import Log
from ..identification.logged_inputs import logged_inputs
from ..physics.effects import EFFECTS, CandidateEffect, DiagnosisContext
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel, lacks_dry_friction
from .signals import noise_of
from .unknown_inputs import balance_signals, unknown_inputs

#: Effort scale of rod [N] and shaft [N m] for which the effect files state the smallest changes of symbols: the EHSA's.
REFERENCE_EFFORT = {"rod": 1e3, "shaft": 1.0}
#: Lower bound of a positive parameter as a share of its nominal value. Engineering judgement.
MIN_SHARE = 0.02
#: Smallest number of moving samples for `friction_levels`: 0.2 s at 250 Hz for three unknowns. Engineering judgement.
MIN_SAMPLES = 50


def candidate_effects(model: HypothesisModel, logs: Sequence[Log] = ()) -> tuple[CandidateEffect, ...]:
    """All effects that can act in this plant and show in these logs, by default that of the model.

    logs: with the same channels and sample time.
    """
    plant, logs = model.plant, logs or (model.log,)
    system, equations = plant.structure.system, plant.structure.equations
    # The rod's if there is one: the effects that state efforts are mostly its own.
    contact = next(iter(sorted(system.contacts, key=lambda one: one.name)), None)
    bounds = {}
    for kind in equations.parameters:
        positive = kind.lower_open and kind.lower == 0.0
        bounds[kind.name] = (MIN_SHARE * plant[kind.name] if positive else kind.lower, kind.upper)
    context = DiagnosisContext(
        log=_joined(logs),
        channels=model.channels,
        slopes=frozenset(one.channel for one in system.scored if one.span),
        outputs=system.outputs,
        drive=system.drive,
        values=plant.values,
        own_name=system.own,
        needed=frozenset(needed_to_simulate(equations)),
        bounds=bounds,
        effort=contact.effort_scale / REFERENCE_EFFORT[contact.name] if contact else 1.0,
        sensors={channel: {"bias": s.bias, "scale": s.scale} for channel, s in plant.sensors.items()},
        switches_law=bool(model.plants_by_law),
        friction_levels=_mean_levels([friction_levels(plant, log) for log in logs]),
    )
    found = [
        candidate
        for effect in EFFECTS.values()
        if not effect.wired or effect.symbols or effect.name in plant.structure.effects
        for candidate in effect.free_in(context)
    ]
    # Where one contact stands for shaft and rod, a friction parameter has two ids; the first one counts.
    taken = {candidate.names: candidate.id for candidate in reversed(found) if candidate.effect.symbols}
    return tuple(one for one in found if not one.effect.symbols or taken[one.names] == one.id)


def _joined(logs: Sequence[Log]) -> Log:
    """All samples as one log, for ranges and quantiles."""
    if len(logs) == 1:
        return logs[0]
    channels = {name: np.concatenate([log[name] for log in logs]) for name in logs[0].channels}
    dt = logs[0].sample_time
    return Log(dt * np.arange(sum(map(len, logs))), channels)


def _mean_levels(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean over the logs that show a level."""
    names = dict.fromkeys(name for one in found for name in one)
    return {name: float(np.mean([one[name] for one in found if name in one])) for name in names}


def wearing_parameters() -> frozenset[str]:
    """Parameters that wear changes by orders of magnitude, such as a leakage coefficient."""
    return frozenset(symbol for effect in EFFECTS.values() for symbol in effect.wear_scales)


def friction_levels(plant: Plant, log: Log) -> dict[str, float]:
    """Initial values of friction and constant effort for a plant without dry friction: symbol -> value, SI units.

    Least squares of each contact's unknown input on sign of speed, speed and a constant, over the samples in motion.
    The search needs these values, because derivatives at zero friction do not lead to the friction that is missing.
    """
    if not lacks_dry_friction(plant):
        return {}
    # Without effects, because their states are not measured.
    plain = plant.with_structure(replace(plant.structure, effects=()))
    drive, second_input = logged_inputs(plain, log)
    signals = balance_signals(plain, log, drive, noise_of(plain, log), second_input=second_input)
    unknown = unknown_inputs(plain, signals).values
    found: dict[str, float] = {}
    system = plain.structure.system
    of_contact = {contact: balance.unknown_inputs[0] for balance in system.balances for contact in balance.contacts}
    for contact in system.contacts:
        name = of_contact.get(contact.name, "")
        if name not in unknown:
            continue
        # A positive unknown torque drives the motion, a positive unknown force resists it.
        sign = 1.0 if name == "force" else -1.0
        speed = signals[contact.velocity][:-1]
        moves = (np.abs(speed) > contact.stribeck_speed) & np.isfinite(unknown[name])
        if np.count_nonzero(moves) >= MIN_SAMPLES:
            x = np.column_stack([np.sign(speed), speed, np.ones_like(speed)])[moves]
            level, slope, offset = (sign * np.linalg.lstsq(x, unknown[name][moves], rcond=None)[0]).tolist()
            found |= {f"A_{contact.suffix}": max(level, 0.0), f"B_{contact.suffix}": max(slope, 0.0)}
            found |= {contact.constant: offset} if contact.constant else {}
    return found


def with_parameters(
    members: Sequence[CandidateEffect],
    parameters: Sequence[str],
    candidates: Sequence[CandidateEffect],
    ids: Mapping[str, str],
) -> tuple[CandidateEffect, ...]:
    """Effects together with those that stand for wrong nominal parameters, each in its smallest form that holds them.

    ids: parameter -> id of the effect. A parameter that a member sets free already is left out.
    """
    found = list(members)
    for id in dict.fromkeys(ids[name] for name in parameters if name in ids):
        wanted = {name for name in parameters if ids.get(name) == id}
        forms = [c for c in candidates if c.id == id and c.channel is None and set(c.names) & wanted]
        forms = [c for c in forms if not any(set(c.names) & set(m.names) for m in found)]
        if forms:
            found.append(min(forms, key=lambda c: (len(wanted - set(c.names)), len(c.names))))
    return tuple(found)
