"""The improved plant: the nominal plant with the causes as effects, and estimated parameters with deviations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..core.parameter import Parameter
from ..physics.effects import EFFECTS, CandidateEffect, EffectParameter, with_extended
from ..plant.plant import SENSOR_WORDS, Plant
from .acting_model import law_switches
from .hypothesis_model import Setting, absent_friction
from .refit import stated_sd


def improved_plant(
    plant: Plant, candidates: tuple[CandidateEffect, ...], values: Setting, sd: Mapping[str, float]
) -> Plant:
    """A plant whose simulation equals that of a hypothesis.

    values: parameters and sensor settings of the hypothesis, SI units. sd: standard deviations of those of its effects.
    Fitted parameters get the source "identified"; other parameters of an effect keep the source of their typical value.
    """
    found, deviations = dict(values), dict(sd)
    structure, added = plant.structure, dict[str, Parameter]()
    for switch in (switch for switch in law_switches() if switch.active(values)):
        structure = replace(structure, rod_friction=switch.law)
        law = switch.parameters(values, plant.values)
        found[switch.parameter] = law[switch.parameter]
        if switch.number in sd:
            deviations[switch.parameter] = sd[switch.number] / values[switch.number] ** 2
        note = f"default of {switch.law}, not fitted"
        added |= {n: Parameter(n, v, "", "assumed", note=note) for n, v in law.items() if n not in found}
    for contact in structure.system.contacts:
        absent = {n: v for n, v in absent_friction(contact).items() if n not in plant.parameters}
        if any(values.get(name, value) != value for name, value in absent.items()):
            changes: dict[str, Any] = {f"{contact.name}_friction": "stribeck"}
            structure = replace(structure, **changes)
            note = "friction added by a diagnosis, this value not fitted"
            added |= {n: Parameter(n, v, "", "assumed", note=note) for n, v in absent.items() if n not in values}
    named = {c.effect.name for c in candidates}
    # A law that was just found is not listed in the catalogue.
    known_effects = {**EFFECTS.members(), **{c.effect.name: c.effect for c in candidates}}
    effects = {n: e for n, e in known_effects.items() if e.wired and (n in named or e.extends in named)}
    effects = {n: e for n, e in effects.items() if any(p.name in values for p in e.parameters)}
    first = [p for effect in known_effects.values() for p in effect.parameters[:1] if p.name in values]
    found |= {p.name: p.neutral for p in first if p.is_negligible(values[p.name])}
    structure = replace(structure, effects=tuple(dict.fromkeys([*structure.effects, *with_extended(effects)])))
    for name, effect in effects.items():
        added |= {p.name: _default_parameter(name, p) for p in effect.parameters if p.name not in plant.parameters}
    known = structure.equations.parameter_names
    given = {n: p.value for n, p in added.items()} | {n: v for n, v in found.items() if n in known}
    changed = plant.with_structure(structure, **given)
    parameters = dict(changed.parameters)
    known_sd = {name: stated_sd(one) for name, one in deviations.items()}
    for name in given:
        if name in found:
            note = "cause found by a diagnosis" if name in known_sd else "refitted by a diagnosis"
            parameters[name] = replace(parameters[name], source="identified", sd=known_sd.get(name), note=note)
        else:
            parameters[name] = replace(parameters[name], source=added[name].source, note=added[name].note)
    return replace(changed, parameters=parameters, sensors=_sensors(changed, values, known_sd))


def _default_parameter(effect: str, parameter: EffectParameter) -> Parameter:
    """A parameter that an effect needs and that was not fitted: neutral, which may be its typical value."""
    typical = parameter.neutral == parameter.typical
    note = f"typical value of {effect}, not fitted" if typical else f"neutral value in {effect}, not fitted"
    source = parameter.source if typical else "assumed"
    return Parameter(parameter.name, parameter.neutral, parameter.unit, source, note=note)


def _sensors(plant: Plant, values: Setting, sd: Mapping[str, float | None]) -> dict[str, Any]:
    """The plant's sensors with the estimated errors; delays and filters add to the nominal ones."""
    sensors = dict(plant.sensors)
    for name, value in values.items():
        setting, dot, channel = name.partition(".")
        if dot and channel in sensors and setting in SENSOR_WORDS:
            sensor = sensors[channel]
            total = value + getattr(sensor, setting) if setting in ("delay", "filter") else value
            stated = Parameter(f"{channel} {setting}", total, sensor.unit_of(setting), "identified", sd.get(name))
            new: dict[str, Any] = {setting: total, "stated": (*sensor.stated, stated)}
            sensors[channel] = replace(sensor, **new)
    return sensors
