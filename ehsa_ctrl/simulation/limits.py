"""Limits of the plant, checked in every run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..core.unit import factor
from ..plant.plant import Plant

#: Limit -> unit in which it is printed.
SHOWN = {
    "pump_speed": "rpm",
    "motor_speed": "rpm",
    "motor_torque": "N m",
    "motor_power": "kW",
    "current_rms": "A",
    "pressure_max": "bar",
    "pressure_min": "bar",
    "stroke": "mm",
}

#: Limit -> name of its quantity.
NAMES = {
    "pump_speed": "pump speed",
    "motor_speed": "motor speed",
    "motor_torque": "motor torque",
    "motor_power": "mean motor power",
    "current_rms": "RMS current",
    "pressure_max": "a pressure",
    "pressure_min": "a pressure",
    "stroke": "stroke (distance from mid-stroke)",
}

#: Limit -> states that it bounds at each instant, share of the limit at which they pass it, and the sides. The motor
#: torque bounds the current; averages over the run bound no signal.
BOUNDED = {
    "pump_speed": (("omega",), 1.0, "both"),
    "motor_speed": (("omega",), 1.0, "both"),
    "pressure_max": (("P_1", "P_2"), 1.0, "high"),
    "pressure_min": (("P_1", "P_2"), 1.0, "low"),
    "stroke": (("x",), 0.5, "both"),
}


def range_of(limit: str, allowed: float) -> tuple[float, float]:
    """Range of the states in BOUNDED that a limit allows."""
    _, share, sides = BOUNDED[limit]
    bound = share * allowed
    return {"low": (bound, np.inf), "high": (-np.inf, bound), "both": (-bound, bound)}[sides]


def scale_of(limit: str, unit: str) -> float:
    """SI units of a limit per printed unit; a stroke is printed as the distance from mid-stroke, half of it."""
    return factor(SHOWN[limit], unit) * (2.0 if limit == "stroke" else 1.0)


@dataclass(frozen=True)
class Exceedance:
    """A limit that a run exceeded: name, limit, worst value and time of the first sample beyond it.

    first: nan for averages over the run, and if the limit was only exceeded between samples.
    """

    limit: str
    unit: str
    allowed: float
    reached: float
    first: float

    def __str__(self) -> str:
        when = "" if np.isnan(self.first) else f", first at {self.first:.3f} s"
        verb = "fell to" if self.limit == "pressure_min" else "reached"
        scale = scale_of(self.limit, self.unit)
        reached = self.reached / scale
        figure = f"{reached:.0f}" if abs(reached) >= 1000 else f"{reached:.4g}"
        return f"{NAMES[self.limit]} {verb} {figure} {SHOWN[self.limit]} (limit {self.allowed / scale:.4g}){when}"


def reached(plant: Plant, current: np.ndarray, states: np.ndarray, extremes: np.ndarray) -> dict[str, float]:
    """Limit (as in `file.LIMIT_UNITS`) -> worst value of its quantity in a run, SI units.

    current (N,), states (N, n), extremes (2, n) as in a Trajectory.
    """
    return {name: worst for name, (worst, _) in _watched(plant, current, states, extremes).items()}


def exceedances(
    plant: Plant, time: np.ndarray, current: np.ndarray, states: np.ndarray, extremes: np.ndarray
) -> Iterator[Exceedance]:
    """Limits of the plant that a run exceeded.

    Speeds, pressures and stroke are checked between samples too. Power and current are averages over the run, for the
    motor's continuous rating.
    """
    watched = _watched(plant, current, states, extremes)
    for name, limit in plant.limits.items():
        worst, signal = watched[name]
        if name == "pressure_min":
            beyond = np.flatnonzero(signal < limit.value)
            passed = worst < limit.value
        else:
            beyond = np.flatnonzero(signal > limit.value)
            passed = worst > limit.value
        if passed:
            first = float(time[beyond[0]]) if beyond.size else float("nan")
            yield Exceedance(name, limit.unit, limit.value, worst, first)


def _watched(
    plant: Plant, current: np.ndarray, states: np.ndarray, extremes: np.ndarray
) -> dict[str, tuple[float, np.ndarray]]:
    """Limit -> worst value in the run, and the signal (N,) that it limits; empty for an average."""
    index = plant.structure.equations.index
    has = {state.name for state in plant.structure.equations.states}
    watched: dict[str, tuple[float, np.ndarray]] = {}

    def worst(name: str) -> float:
        return float(np.max(np.abs(extremes[:, index(name)])))

    if "omega" in has:
        omega = states[:, index("omega")]
        torque = plant["K_T"] * current
        watched |= {
            "pump_speed": (worst("omega"), np.abs(omega)),
            "motor_speed": (worst("omega"), np.abs(omega)),
            "motor_torque": (float(np.max(np.abs(torque))), np.abs(torque)),
            "motor_power": (float(np.mean(np.abs(torque * omega))), np.array([])),
            "current_rms": (float(np.sqrt(np.mean(current**2))), np.array([])),
        }
    if "P_1" in has:
        P_1, P_2 = states[:, index("P_1")], states[:, index("P_2")]
        low, high = extremes[0], extremes[1]
        watched["pressure_max"] = (float(max(high[index("P_1")], high[index("P_2")])), np.maximum(P_1, P_2))
        watched["pressure_min"] = (float(min(low[index("P_1")], low[index("P_2")])), np.minimum(P_1, P_2))
    if "x" in has:
        watched["stroke"] = (2 * worst("x"), 2 * np.abs(states[:, index("x")]))
    return watched
