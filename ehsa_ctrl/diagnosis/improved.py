"""The believed plant with what was found: the effects as equations, the numbers with their deviations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..core.parameter import Parameter
from ..physics.effects import EFFECTS, EffectParameter
from ..physics.effects.presliding import DAMPING, HARD, SOFTNESS
from ..plant.plant import SENSOR_WORDS, Plant
from ..plant.structure import Structure
from .suspect import Suspect
from .twin import DRY


def improved(
    plant: Plant, suspects: tuple[Suspect, ...], values: Mapping[str, float], sd: Mapping[str, float]
) -> Plant:
    """A plant that runs as the twin does at these values.

    values: symbols and sensor words, those of nominal parameters too. sd: of those that were found. What an effect
        needs beside these keeps the source of its typical value: only what was fitted is called identified.
    """
    wired = [s.id for s in suspects if EFFECTS[s.id].wired and EFFECTS[s.id].parameters]
    wired = [name for name in dict.fromkeys(wired) if any(p.name in values for p in EFFECTS[name].parameters)]
    structure = plant.structure
    found = dict(values)
    deviations = dict(sd)
    kept: dict[str, Parameter] = {}
    if values.get(SOFTNESS, 0.0) > HARD:
        structure = replace(structure, rod_friction="lugre")
        softness = values[SOFTNESS]
        found["sigma_0_FR"] = 1.0 / softness
        if SOFTNESS in sd:
            deviations["sigma_0_FR"] = sd[SOFTNESS] / softness**2
        if DAMPING not in values:
            usual = (plant["M"] / softness) ** 0.5
            kept[DAMPING] = Parameter(DAMPING, usual, "N s/m", "assumed", note="root of M times sigma_0, not fitted")
    for contact, word in (("FM", "shaft_friction"), ("FR", "rod_friction")):
        own = {structure.system.own(name): value for name, value in DRY.items() if name.endswith(contact)}
        dry = [name for name in own if name not in plant.parameters]
        if any(name in values and values[name] != own[name] for name in dry):
            changes: dict[str, Any] = {word: "stribeck"}
            structure = replace(structure, **changes)
            note = "of a friction that the plant lacked, not fitted"
            kept |= {n: Parameter(n, own[n], "", "assumed", note=note) for n in dry if n not in values}
    structure = replace(structure, effects=(*structure.effects, *(n for n in wired if n not in structure.effects)))
    for name in wired:
        kept |= {p.name: _typical(name, p) for p in EFFECTS[name].parameters if p.name not in plant.parameters}
    given = {n: p.value for n, p in kept.items()} | {n: v for n, v in found.items() if _is_symbol(structure, n)}
    changed = plant.with_structure(structure, **given)
    parameters = dict(changed.parameters)
    for name in given:
        if name in found:
            note = "found by a diagnosis" if name in deviations else "refitted with a diagnosis"
            parameters[name] = replace(parameters[name], source="identified", sd=deviations.get(name), note=note)
        else:
            parameters[name] = replace(parameters[name], source=kept[name].source, note=kept[name].note)
    sensors = dict(changed.sensors)
    for name, value in values.items():
        word, dot, channel = name.partition(".")
        if not dot or channel not in sensors or word not in SENSOR_WORDS:
            continue
        sensor = sensors[channel]
        # The twin adds delays and filters to those that are believed already.
        total = value + getattr(sensor, word) if word in ("delay", "filter") else value
        stated = Parameter(f"{channel} {word}", total, sensor.unit_of(word), "identified", sd.get(name))
        new: dict[str, Any] = {word: total, "stated": (*sensor.stated, stated)}
        sensors[channel] = replace(sensor, **new)
    return replace(changed, parameters=parameters, sensors=sensors)


def _is_symbol(structure: Structure, name: str) -> bool:
    return name in structure.equations.parameter_names


def _typical(effect: str, parameter: EffectParameter) -> Parameter:
    """A number that an effect needs and no log was asked for."""
    note = f"typical of {effect}, not fitted"
    if parameter.neutral != parameter.typical:
        note = f"{effect} without this part, not fitted"
    source = parameter.source if parameter.neutral == parameter.typical else "assumed"
    return Parameter(parameter.name, parameter.neutral, parameter.unit, source, note=note)
