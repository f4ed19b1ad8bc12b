"""What is simulated of a hypothesis: the plant with the effects that act in it, and what its runs have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.syntax import argument_names
from ..physics.effects import EFFECTS, Effect, LawSwitch
from ..plant.plant import Plant, Sensor


@dataclass(frozen=True)
class ActingModel:
    """A plant with the effects that act in a hypothesis.

    switch: of the rod's friction law, None if it is the nominal one.
    """

    plant: Plant
    switch: LawSwitch | None

    @cached_property
    def columns(self) -> dict[str, int]:
        """Parameter -> column of the parameter vector."""
        return {name: i for i, name in enumerate(self.plant.structure.equations.parameter_names)}

    @cached_property
    def positions(self) -> dict[str, int]:
        """State -> position in the state vector."""
        return {state.name: i for i, state in enumerate(self.plant.structure.equations.states)}

    @cached_property
    def _vector(self) -> np.ndarray:
        return self.plant.vector

    @cached_property
    def _rest(self) -> np.ndarray:
        return self.plant.rest

    @cached_property
    def _effects(self) -> tuple[Effect, ...]:
        """Its effects that have states."""
        effects = map(EFFECTS.__getitem__, self.plant.structure.effects)
        return tuple(effect for effect in effects if effect.states)

    def parameters(self, values: Mapping[str, float]) -> np.ndarray:
        """The parameter vector (n,) with these values."""
        row = self._vector.copy()
        for name, value in values.items():
            row[self.columns[name]] = value
        return row

    def start(
        self,
        values: Mapping[str, float],
        measured: Mapping[str, float],
        sensors: Mapping[str, Sensor],
        drive: float,
        switches: tuple[LawSwitch, ...],
    ) -> np.ndarray:
        """State (n,) at the first sample of a run that starts in motion.

        Measured states are corrected for the sensor errors of the hypothesis. States of neutral effects are zero.

        values: of the hypothesis. measured: state -> value by the nominal sensors. sensors: the nominal ones. drive:
        at the first sample. switches: of all friction laws, whose states may be in the nominal plant too.
        """
        state, plant = self._rest.copy(), self.plant
        channels = {name: channel for channel, name in plant.structure.system.outputs.items()}

        def value(name: str) -> float:
            return values.get(name, plant[name] if name in plant.parameters else 0.0)

        for name, level in measured.items():
            channel = channels.get(name, "")
            if name not in self.positions:
                continue
            if channel in sensors:
                sensor = sensors[channel]
                bias, scale = values.get(f"bias.{channel}", sensor.bias), values.get(f"scale.{channel}", sensor.scale)
                level = (level * sensor.scale + sensor.bias - bias) / scale
            state[self.positions[name]] = level
        for effect in self._effects:
            present = effect.parameters and value(effect.parameters[0].name) != effect.parameters[0].neutral
            for own in effect.states:
                if not present:
                    state[self.positions[own.name]] = 0.0
                elif own.starts_at == plant.structure.system.inputs[0]:
                    state[self.positions[own.name]] = drive
        for switch in switches:
            asked = argument_names(switch.deflection)
            if switch.state in self.positions and all(n in self.positions or n in plant.parameters for n in asked):
                given = {n: state[self.positions[n]] if n in self.positions else value(n) for n in asked}
                compliance = values[switch.number] if switch.active(values) else 1.0 / plant[switch.parameter]
                state[self.positions[switch.state]] = switch.deflection(**given) * compliance
        return state


@dataclass(frozen=True)
class ActingModels:
    """The models of hypotheses about one plant, by what acts in each. The parts and windows of a log share them.

    plant, by_law: see `HypothesisModel`. replayed: effects that follow a measured channel of the log.
    """

    plant: Plant
    by_law: Mapping[str, Plant]
    replayed: tuple[str, ...]

    def of(self, values: Mapping[str, float]) -> ActingModel:
        """The plant with the friction law of a hypothesis and those effects alone that act in it."""
        switch = next((one for one in self.switches if one.active(values)), None)
        law = "" if switch is None else switch.law
        full = self.by_law.get(law, self.plant)
        acts = dict(self._nominally[law])
        for effect in {effect for name in values for effect in self._owners.get(name, ())}:
            if effect.name in acts:
                acts[effect.name] = _acts(effect, values, full)
        names = tuple(
            effect.name for effect in self._simulated if acts[effect.name] and acts.get(effect.extends or "", True)
        )
        known = self._known.get((law, names))
        if known is None:
            plant = full.with_structure(replace(full.structure, effects=names))
            known = self._known.setdefault((law, names), ActingModel(plant, switch))
        return known

    def changed(self, acting: ActingModel, values: Mapping[str, float]) -> dict[str, float]:
        """The parameters that a hypothesis changes in a model; those of effects that it lacks are left out."""
        changed = {name: value for name, value in values.items() if "." not in name and name not in self._of_switches}
        if acting.switch is not None:
            changed |= acting.switch.parameters(values, acting.plant.values)
        known = self.plant.parameters
        return {name: value for name, value in changed.items() if name in acting.columns or name not in known}

    @cached_property
    def switches(self) -> tuple[LawSwitch, ...]:
        """See `law_switches`."""
        return law_switches()

    @cached_property
    def _known(self) -> dict[tuple[str, tuple[str, ...]], ActingModel]:
        """(law of a switch, names of the effects) -> model."""
        return {}

    @cached_property
    def _nominally(self) -> dict[str, dict[str, bool]]:
        """Law of a switch -> effect -> whether it acts at the plant's own values."""
        plants = {"": self.plant, **{switch.law: self.plant for switch in self.switches}, **self.by_law}
        return {
            law: {
                effect.name: effect.name in plant.structure.effects and _acts(effect, {}, plant)
                for effect in self._simulated
            }
            for law, plant in plants.items()
        }

    @cached_property
    def _simulated(self) -> tuple[Effect, ...]:
        """The effects of the plant that do not follow a measured channel."""
        return tuple(EFFECTS[name] for name in self.plant.structure.effects if name not in self.replayed)

    @cached_property
    def _owners(self) -> dict[str, tuple[Effect, ...]]:
        """Parameter -> simulated effects that have it."""
        owners: dict[str, tuple[Effect, ...]] = {}
        for effect in self._simulated:
            for parameter in effect.parameters:
                owners[parameter.name] = (*owners.get(parameter.name, ()), effect)
        return owners

    @cached_property
    def _of_switches(self) -> frozenset[str]:
        """Free numbers of the law switches, which are no parameters of the plant."""
        return frozenset(name for one in self.switches for name in (one.number, *one.defaults))


def law_switches() -> tuple[LawSwitch, ...]:
    """Replacements of the rod's friction law that a hypothesis may contain."""
    return tuple(effect.switch for effect in EFFECTS.members().values() if effect.switch is not None)


def _acts(effect: Effect, values: Mapping[str, float], plant: Plant) -> bool:
    """Whether an effect of a plant acts with these values, and is not negligible."""
    if not effect.parameters:
        return True
    own = [values.get(p.name, plant[p.name]) for p in effect.parameters]
    if effect.parameters[0].is_negligible(own[0]):
        return False
    return any(value != p.neutral for p, value in zip(effect.parameters, own, strict=True))
