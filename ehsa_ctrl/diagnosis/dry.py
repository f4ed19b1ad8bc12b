"""How much dry friction a log shows where none is believed: starting values from the balances of torque and force."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from ..core.log import Log
from ..plant.plant import Plant

#: Samples of the parabolas that give speeds and slopes.
WIDTH = 11


def dry_friction(plant: Plant, log: Log) -> dict[str, float]:
    """Coulomb levels of shaft and rod, A_FM [N m] and A_FR [N], from a log; those that it can't tell are missing.

    Least squares of what the believed balance lacks on the direction of motion, the speed and a constant, where the
    contact plainly moves. Of a carriage, whose drive force is known, B_FR and F_0 too.
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
        found["A_FM"] = _level(torque, omega, 10.0)
    if "position" in log.channels and not plant.structure.system.prescribed:
        v = savgol_filter(log["position"], WIDTH, 2, deriv=1, delta=dt)
        x = log["position"]
        outside = log["force"] if "force" in log.channels else plant["K_S"] * x
        found["A_FR"] = _level(plant["A"] * pressure - outside, v, 0.01)
    return {name: value for name, value in found.items() if value > 0.0}


def _level(effort: np.ndarray, speed: np.ndarray, least: float) -> float:
    """The part of an effort that has the sign of a speed, beside what is proportional to it and what is constant."""
    return _line(effort, speed, least)[0]


def _line(effort: np.ndarray, speed: np.ndarray, least: float) -> tuple[float, float, float]:
    """What of an effort has the sign of a speed, what is proportional to it [1/speed], and what is constant."""
    moves = np.abs(speed) > least
    if np.count_nonzero(moves) < 50:
        return 0.0, 0.0, 0.0
    basis = np.column_stack([np.sign(speed), speed, np.ones_like(speed)])[moves]
    sign, slope, constant = np.linalg.lstsq(basis, effort[moves], rcond=None)[0]
    return float(sign), float(slope), float(constant)
