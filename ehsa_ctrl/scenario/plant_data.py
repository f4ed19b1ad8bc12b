"""Plant data for controllers: ratings, and the noise and friction that a design review uses."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core.controller_interface import MEASURED
from ..core.definition import merged
from ..core.errors import InputError
from ..core.unit import parse
from ..design.controller import SampledController
from ..design.kinds import ControllerFile
from ..design.load import build_controller, load_controller, read_content
from ..design.review import Known
from ..plant.motion_current import has_motion_current, is_carriage, motion_current
from ..plant.plant import Plant

if TYPE_CHECKING:
    import control

#: Unit of a drive -> shipped plant with such a drive.
PLANT_WITH_DRIVE = {"A": "ehsa", "N": "emps"}
#: Key of a controller's TOML -> the plant rating that bounds it.
BOUNDED = {
    "current_limit": "current",
    "force.limit": "force",
    "position.speed_limit": "speed",
    "limits.speed": "speed",
    "limits.pressure": "pressure",
    "limits.stroke": "reach",
    "trajectory.speed": "rod_speed",
}


class Rating(NamedTuple):
    """Largest admissible value, its SI unit, and the expression in keys of the plant's file that gives it."""

    value: float
    unit: str
    source: str


def plant_with_drive(limit: Any) -> str:
    """Name of the shipped plant whose drive has the unit of a controller's current_limit; the EHSA for any other."""
    for unit, name in PLANT_WITH_DRIVE.items():
        with suppress(InputError):
            parse(str(limit), unit)
            return name
    return "ehsa"


def ratings(plant: Plant) -> dict[str, Rating]:
    """Ratings from a plant's [limits], as far as the file determines them.

    Keys: current, speed (shaft), rod_speed, pressure (difference), force (static, both chambers
    within their limits), reach (travel to either side of mid-stroke).
    """
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
        if "P_0" in plant.parameters:
            # At rest P_1 + P_2 = 2 P_0: one chamber rises as the other falls.
            rise, fall = limit["pressure_max"] - plant["P_0"], plant["P_0"] - lowest
            source = "2 A (P_0 - pressure_min)" if fall < rise else "2 A (pressure_max - P_0)"
            found["force"] = Rating(2.0 * plant["A"] * min(rise, fall), "N", source)
    if "stroke" in limit:
        found["reach"] = Rating(0.5 * limit["stroke"], "m", "stroke / 2")
    return found


def check_controller_limits(file: Path | str, definition: ControllerFile, plant: Plant) -> None:
    """Raise InputError if a limit in the controller's file exceeds the plant's rating."""
    allowed = ratings(plant)
    for key, name in BOUNDED.items():
        value: object = definition
        for word in key.split("."):
            value = getattr(value, word, None)
        if isinstance(value, float) and name in allowed and value > allowed[name].value * (1 + 1e-9):
            most, unit, source = allowed[name]
            table, _, word = key.rpartition(".")
            raise InputError(
                f"{file}: {f'[{table}] ' if table else ''}{word} = {value:.4g} {unit} exceeds the rating of the plant "
                f"{plant.name}, {most:.4g} {unit} ({source}); lower it, or create a controller for this plant with "
                f"ehsa-ctrl new controller NAME --plant {plant.name}"
            )


def own_controller(given: Any, plant: Plant, model: control.StateSpace) -> SampledController:
    """A controller from a dictionary or a Python object (see `load_controller`), for this plant and its design model.

    A law of the user's own that states no current limit has that of the plant's ratings.

    Raises InputError as `load_controller` does, for limits beyond the plant's ratings, and for a law without limit if
    the plant has no such rating.
    """
    if isinstance(given, Mapping):
        content = merged({"schema": 1, "title": "own", **given}, {})
        kind, definition = read_content(
            content, "controller own", plant.sample_time, plant.structure.system.drive_unit, si=True
        )
        check_controller_limits("controller own", definition, plant)
        return build_controller("own", kind, definition, model)
    rated = ratings(plant).get("current")
    if rated is None:
        unit = plant.structure.system.drive_unit
        raise InputError(
            f"{plant.name}: its [limits] tell no largest drive for a law of your own; give it, "
            f"load_controller(law, current_limit='100 {unit}')"
        )
    limit: dict[str, Any] = {} if rated is None else {"current_limit": rated.value}
    return load_controller(given, model, sample_time=plant.sample_time, **limit)


def known_of(plant: Plant) -> Known:
    """Plant data for `review`: sensor noise and, for the nonlinear set of an EHSA, friction and half the stroke.

    Callers add the smallest slip and the solver time with `dataclasses.replace`.
    """
    noise = {channel: plant.sensors[channel].sd for channel in MEASURED if channel in plant.sensors}
    if plant.model != "nonlinear" or not (has_motion_current(plant) or is_carriage(plant)):
        return Known(noise=noise)
    needed, stroke = motion_current(plant), plant.limits.get("stroke")
    return Known(
        static=needed["static"],
        coulomb=needed["coulomb"],
        reach=0.5 * stroke.value if stroke is not None else nan,
        noise=noise,
    )
