"""Candidate effects: every effect that this plant and this log could show, with the numbers that it sets free."""

from __future__ import annotations

from dataclasses import replace

from ..core.errors import InputError
from ..core.log import Log
from ..identification.balances import estimate_by_balances
from ..physics.effects import EFFECTS, CandidateEffect, DiagnosisContext
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel, without_dry_friction

#: The effort of a rod for which the smallest changes of an effect's symbols are stated [N].
REFERENCE_EFFORT = 1e3
#: A parameter that has to be positive may fall to this share of its nominal value.
LEAST_SHARE = 0.02


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

    Starting values: all of a missing friction is too far from none for a search by derivatives.
    """
    if not without_dry_friction(plant):
        return {}
    system = plant.structure.system
    # Without effects, whose states nothing measures.
    plain = plant.with_structure(replace(plant.structure, effects=()))
    missing = (e.groups[0][0] if e.groups else next(iter(e.symbols)) for e in EFFECTS.values() if e.from_balances)
    viscous = (f"B_{contact.suffix}" for contact in system.contacts)
    named = {symbol: system.own(symbol) for symbol in (*missing, *viscous)}
    try:
        found = estimate_by_balances(
            plain, log, [name for name in dict.fromkeys(named.values()) if name in plain.parameters]
        )
    except InputError:
        return {}
    return {symbol: found[name] for symbol, name in named.items() if name in found.parameters}
