"""A sensor has a first-order filter."""

from ._candidate import Candidate, Free, Rig, from_sensors
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor, the drive's too."""
    return from_sensors(rig, lambda channel, _: Free(f"filter.{channel}", 0.0, 1e-3, 0.0, 0.2), 2.0, drive=True)


effect = Effect(
    name="sensor_filter",
    place="sensor",
    summary="first-order filter in a sensor",
    fingerprint="one channel is late and smooth against all others",
    sensor="filter",
    candidates=candidates,
    source="definition",
)
