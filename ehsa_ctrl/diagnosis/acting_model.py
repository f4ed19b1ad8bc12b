"""What is simulated of a hypothesis: the plant with the effects that act in it, and what its runs have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
