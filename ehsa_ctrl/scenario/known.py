"""What a review asks of a plant beside its linear model."""

from __future__ import annotations

from math import nan

from ..core.controller_interface import MEASURED
from ..design.review import Known
from ..plant.motion_current import motion_current
from ..plant.plant import Plant


def known_of(plant: Plant) -> Known:
    """What `review` can be told of a plant: its sensors' noise and, of a nonlinear set, friction and half its stroke.

    The smallest slip and a solver's time are not in it; `dataclasses.replace` adds them.

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
