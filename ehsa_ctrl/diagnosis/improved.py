"""The believed plant with what was found: the effects as equations, the numbers with their deviations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..core.parameter import Parameter
from ..physics.effects import EFFECTS
from ..plant.plant import SENSOR_WORDS, Plant
from .suspects import Suspect
from .twin import BRISTLES, DAMPING, DRY, HARD


def improved(
    plant: Plant, suspects: tuple[Suspect, ...], values: Mapping[str, float], sd: Mapping[str, float]
) -> Plant:
    """A plant that runs as the twin does at these values.

    values: letters and sensor words, those of nominal parameters too. sd: of those that were found.
    """
    wired = [s.id for s in suspects if EFFECTS[s.id].wired and EFFECTS[s.id].parameters]
    wired = [name for name in dict.fromkeys(wired) if any(p.name in values for p in EFFECTS[name].parameters)]
    structure = plant.structure
    letters: dict[str, float] = {}
    if values.get(BRISTLES, 0.0) > HARD:
        structure = replace(structure, rod_friction="lugre")
        usual = (plant["M"] / values[BRISTLES]) ** 0.5
        letters |= {"sigma_0_FR": 1.0 / values[BRISTLES], DAMPING: values.get(DAMPING, usual)}
    for contact, word in (("FM", "shaft_friction"), ("FR", "rod_friction")):
        dry = [name for name in DRY if name.endswith(contact) and name not in plant.parameters]
        if any(name in values and values[name] != DRY[name] for name in dry):
            changes: dict[str, Any] = {word: "stribeck"}
            structure = replace(structure, **changes)
            letters |= {name: values.get(name, DRY[name]) for name in dry}
    structure = replace(structure, effects=(*structure.effects, *(n for n in wired if n not in structure.effects)))
    neutral = {p.name: p.neutral for name in wired for p in EFFECTS[name].parameters}
    changed = plant.with_structure(structure, **{**neutral, **letters})
    changed = changed.set(**{n: v for n, v in values.items() if n in changed.parameters and n not in letters})
    parameters = dict(changed.parameters)
    for name in {*values, *letters, *neutral} & set(parameters):
        note = "found by a diagnosis" if name in sd else "refitted with a diagnosis"
        parameters[name] = replace(parameters[name], source="identified", sd=sd.get(name), note=note)
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
