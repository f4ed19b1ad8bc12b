"""Data of a plant that controllers need: the largest values that it allows, and its noise and friction for a review."""

from __future__ import annotations

from math import nan
from pathlib import Path
from typing import NamedTuple

from ..core.controller_interface import MEASURED
from ..core.errors import InputError
from ..design.kinds import ControllerFile
from ..design.review import Known
from ..plant.motion_current import motion_current
from ..plant.plant import Plant

#: Key of a controller's TOML -> the rating of the plant that bounds it.
BOUNDED = {
    "current_limit": "current",
    "position.speed_limit": "speed",
    "limits.speed": "speed",
    "limits.pressure": "pressure",
    "limits.stroke": "reach",
    "trajectory.speed": "rod_speed",
}


class Rating(NamedTuple):
    """Largest value that a plant allows: value, SI unit, and the keys of its file from which it follows."""

    value: float
    unit: str
    source: str


def ratings(plant: Plant) -> dict[str, Rating]:
    """Largest values by a plant's [limits]: current, speed (of the shaft), rod_speed, pressure (difference), reach (to
    either side of the middle); only those that the file determines."""
    limit = {name: parameter.value for name, parameter in plant.limits.items()}
    found = {}
    if "motor_torque" in limit:
        found["current"] = Rating(limit["motor_torque"] / plant["K_T"], "A", "motor_torque / K_T")
    speeds = {name: limit[name] for name in ("pump_speed", "motor_speed") if name in limit}
    if speeds:
        slowest = min(speeds, key=lambda name: speeds[name])
        found["speed"] = Rating(speeds[slowest], "rad/s", slowest)
        found["rod_speed"] = Rating(speeds[slowest] * plant["D"] / plant["A"], "m/s", f"{slowest} D / A")
    if "pressure_max" in limit:
        lowest = limit.get("pressure_min", 0.0)
        found["pressure"] = Rating(limit["pressure_max"] - lowest, "Pa", "pressure_max - pressure_min")
    if "stroke" in limit:
        found["reach"] = Rating(0.5 * limit["stroke"], "m", "stroke / 2")
    return found


def check_controller_limits(file: Path, definition: ControllerFile, plant: Plant) -> None:
    """Raise InputError for a controller whose limits exceed those of its plant: file, key and both values."""
    allowed = ratings(plant)
    for key, name in BOUNDED.items():
        value: object = definition
        for word in key.split("."):
            value = getattr(value, word, None)
        if isinstance(value, float) and name in allowed and value > allowed[name].value * (1 + 1e-9):
            most, unit, source = allowed[name]
            table, _, word = key.rpartition(".")
            raise InputError(
                f"{file}: {f'[{table}] ' if table else ''}{word} = {value:.4g} {unit} is more than the plant "
                f"{plant.name} allows, {most:.4g} {unit} ({source}); lower it, or begin a controller for this plant "
                f"with ehsa-ctrl new controller NAME --plant {plant.name}"
            )


def known_of(plant: Plant) -> Known:
    """Data of a plant for `review`: sensor noise and, for a nonlinear set, friction and half the stroke.

    It lacks the smallest slip and a solver's time; `dataclasses.replace` adds them.

    Raises InputError as motion_current does.
    """
    noise = {channel: plant.sensors[channel].sd for channel in MEASURED if channel in plant.sensors}
    if plant.model != "nonlinear":
        return Known(noise=noise)
    needed, stroke = motion_current(plant), plant.limits.get("stroke")
    return Known(
        static=needed["static"],
        coulomb=needed["coulomb"],
        reach=0.5 * stroke.value if stroke is not None else nan,
        noise=noise,
    )
