"""The gap of a plant to a log, in free run."""

from __future__ import annotations

from ..core.log import Log
from ..plant.plant import Plant
from .held_out import whole
from .ripple import ripple_of, with_angle
from .signals import noise_of


def gap(plant: Plant, log: Log) -> dict[str, float]:
    """How far a log is from a free run of the plant, by signal.

    Parameters
    ----------
    plant: as it is believed, linear or nonlinear, with its load and its sensors.
    log: drives the run with its current (its drive force for a carriage).

    Returns
    -------
    speed, p1, p2, rod_velocity, as far as the log has them: RMS of measured minus simulated, the sensors' noise taken
    off in quadrature, over the measured signal's standard deviation; inf where the run stopped. total: their RMS.
    """
    log = with_angle(plant, log) if ripple_of(plant) else log
    return whole(plant, plant, log, noise_of(log)).gap({})
