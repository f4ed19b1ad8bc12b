"""Candidate effects: every effect that this plant and this log could show, with the numbers that it sets free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.log import Log
from ..identification.logged_inputs import logged_inputs
from ..physics.effects import EFFECTS, CandidateEffect, DiagnosisContext
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel, without_dry_friction
from .signals import noise_of
from .unknown_inputs import signals_of, unknown_inputs

#: The effort of a rod for which the smallest changes of an effect's symbols are stated [N].
REFERENCE_EFFORT = 1e3
#: A parameter that has to be positive may fall to this share of its nominal value.
LEAST_SHARE = 0.02
#: Samples in motion that friction levels need.
LEAST_SAMPLES = 50


def candidate_effects(model: HypothesisModel) -> tuple[CandidateEffect, ...]:
    """Every effect that this plant and this log could show."""
    plant = model.plant
    system, equations = plant.structure.system, plant.structure.equations
    rods = [contact for contact in system.contacts if contact.name == "rod"]
    bounds = {}
    for kind in equations.parameters:
        positive = kind.lower_open and kind.lower == 0.0
        bounds[kind.name] = (LEAST_SHARE * plant[kind.name] if positive else kind.lower, kind.upper)
    context = DiagnosisContext(
        log=model.log,
        channels=model.channels,
        slopes=frozenset(one.channel for one in system.scored if one.span),
        outputs=system.outputs,
        drive=system.drive,
        values=plant.values,
        own_name=system.own,
        needed=frozenset(needed_to_simulate(equations)),
        bounds=bounds,
        effort=rods[0].effort_scale / REFERENCE_EFFORT if rods else 1.0,
        sensors={channel: {"bias": s.bias, "scale": s.scale} for channel, s in plant.sensors.items()},
        switches_law=bool(model.switched),
        friction_levels=friction_levels(plant, model.log),
    )
    return tuple(
        candidate
        for effect in EFFECTS.values()
        if not effect.wired or effect.symbols or effect.name in plant.structure.effects
        for candidate in effect.free_in(context)
    )


def wearing_parameters() -> frozenset[str]:
    """Parameters that change by orders of magnitude."""
    return frozenset(symbol for effect in EFFECTS.values() for symbol in effect.wears)


def friction_levels(plant: Plant, log: Log) -> dict[str, float]:
    """Friction and offset that the balances show of a plant without dry friction, by symbol in the catalogue.

    Least squares of each contact's unknown input on the sign of its speed, the speed and a constant, where it moves.
    Starting values: all of a missing friction is too far from none for a search by derivatives.
    """
    if not without_dry_friction(plant):
        return {}
    # Without effects, whose states nothing measures.
    plain = plant.with_structure(replace(plant.structure, effects=()))
    drive, outside = logged_inputs(plain, log)
    signals = signals_of(plain, log, drive, noise_of(log), outside=outside)
    unknown = unknown_inputs(plain, signals).values
    found: dict[str, float] = {}
    system = plain.structure.system
    of_contact = {contact: balance.unknown_inputs[0] for balance in system.balances for contact in balance.contacts}
    for contact in system.contacts:
        name = of_contact.get(contact.name, "")
        if name not in unknown:
            continue
        # An unknown torque drives, an unknown force resists.
        sign = 1.0 if name == "force" else -1.0
        speed = signals[contact.velocity][:-1]
        moves = (np.abs(speed) > contact.stribeck_speed) & np.isfinite(unknown[name])
        if np.count_nonzero(moves) >= LEAST_SAMPLES:
            x = np.column_stack([np.sign(speed), speed, np.ones_like(speed)])[moves]
            level, slope, offset = (sign * np.linalg.lstsq(x, unknown[name][moves], rcond=None)[0]).tolist()
            found |= {f"A_{contact.suffix}": max(level, 0.0), f"B_{contact.suffix}": max(slope, 0.0)}
            found |= {contact.constant: offset} if contact.constant else {}
    return found
