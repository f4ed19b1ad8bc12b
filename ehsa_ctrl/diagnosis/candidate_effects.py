"""Candidate effects: every effect that this plant and this log could show, with the numbers that it sets free."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from scipy.signal import savgol_filter

from ..core.log import Log
from ..physics.effects import EFFECTS, CandidateEffect, FreeNumber
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel

#: The effort of a rod for which the smallest changes of an effect's symbols are stated [N].
REFERENCE_EFFORT = 1e3
#: Samples of the parabolas that give speeds and slopes.
WIDTH = 11


def candidate_effects(model: HypothesisModel) -> tuple[CandidateEffect, ...]:
    """Every effect that this plant and this log could show."""
    context = ModelContext(model)
    wired = model.plant.structure.effects
    return tuple(
        candidate
        for effect in EFFECTS.values()
        if not effect.wired or effect.symbols or effect.name in wired
        for candidate in effect.free_in(context)
    )


def wearing_parameters() -> dict[str, float]:
    """Parameters that change by orders of magnitude, and the size of a change."""
    return {symbol: size for effect in EFFECTS.values() for symbol, size in effect.wears.items()}


class ModelContext:
    """A model and its log as effects see them: `DiagnosisContext` in physics/effects."""

    def __init__(self, model: HypothesisModel) -> None:
        self._plant = model.plant
        self._system = model.plant.structure.system
        self._needed = needed_to_simulate(model.plant.structure.equations)
        self.log = model.log
        self.channels = model.channels
        self.drive = self._system.drive
        self.values = model.plant.values
        self.switches_law = bool(model.switched)

    def simulated(self, symbol: str) -> bool:
        return self._system.own(symbol) in self._needed

    def value(self, symbol: str) -> float:
        name = self._system.own(symbol)
        return self._plant[name] if name in self._plant.parameters else 0.0

    def plant_parameter(self, symbol: str, relative: float, smallest: float = 0.0) -> FreeNumber:
        name = self._system.own(symbol)
        value = self._plant[name]
        kind = next(kind for kind in self._plant.structure.equations.parameters if kind.name == name)
        scale = wearing_parameters().get(name, relative * abs(value))
        # A value near zero is as uncertain as zero itself.
        smallest *= self._effort
        scale = smallest if scale < 0.1 * smallest else scale
        lower = 0.02 * value if kind.lower_open and kind.lower == 0.0 else kind.lower
        return FreeNumber(name, value, scale, lower, kind.upper)

    @cached_property
    def _effort(self) -> float:
        """The size of this rod's efforts in REFERENCE_EFFORT."""
        rods = [contact for contact in self._system.contacts if contact.suffix == "FR"]
        return rods[0].effort_scale / REFERENCE_EFFORT if rods else 1.0

    def sensor(self, channel: str, setting: str) -> float:
        return float(getattr(self._plant.sensors[channel], setting))

    def friction_levels(self) -> Mapping[str, float]:
        return friction_levels(self._plant, self.log)


def friction_levels(plant: Plant, log: Log) -> dict[str, float]:
    """Coulomb levels of shaft and rod, A_FM [N m] and A_FR [N], from a log; those that it can't tell are missing.

    Least squares of the residual of the nominal balance on the direction of motion, the speed and a constant, where the
    contact clearly moves. Of a carriage, whose drive force is known, B_FR and F_0 too.
    """
    found: dict[str, float] = {}
    if "F_M" in plant.structure.system.inputs and "position" in log.channels:
        v = savgol_filter(log["position"], WIDTH, 2, deriv=1, delta=log.sample_time)
        slope = savgol_filter(log["position"], 3 * WIDTH, 3, deriv=2, delta=log.sample_time)
        drive = log[plant.structure.system.drive] - plant["M"] * slope
        level, slope_of_v, rest = _line(drive, v, 0.01)
        return {"A_FR": max(level, 0.0), "B_FR": max(slope_of_v, 0.0), "F_0": rest}
    if not {"p1", "p2"} <= set(log.channels):
        return found
    dt, pressure = log.sample_time, log["p1"] - log["p2"]
    if "speed" in log.channels:
        omega = savgol_filter(log["speed"], WIDTH, 2)
        slope = savgol_filter(log["speed"], WIDTH, 2, deriv=1, delta=dt)
        torque = plant["K_T"] * savgol_filter(log["current"], WIDTH, 2) - plant["J_M"] * slope - plant["D"] * pressure
        found["A_FM"] = _line(torque, omega, 10.0)[0]
    if "position" in log.channels and not plant.structure.system.prescribed:
        v = savgol_filter(log["position"], WIDTH, 2, deriv=1, delta=dt)
        x = log["position"]
        outside = log["force"] if "force" in log.channels else plant["K_S"] * x
        found["A_FR"] = _line(plant["A"] * pressure - outside, v, 0.01)[0]
    return {name: value for name, value in found.items() if value > 0.0}


def _line(effort: np.ndarray, speed: np.ndarray, least: float) -> tuple[float, float, float]:
    """Parts of an effort: with the sign of the speed, proportional to it, and constant."""
    moves = np.abs(speed) > least
    if np.count_nonzero(moves) < 50:
        return 0.0, 0.0, 0.0
    basis = np.column_stack([np.sign(speed), speed, np.ones_like(speed)])[moves]
    sign, slope, constant = np.linalg.lstsq(basis, effort[moves], rcond=None)[0]
    return float(sign), float(slope), float(constant)
