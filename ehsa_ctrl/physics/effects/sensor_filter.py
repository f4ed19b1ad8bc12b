"""A sensor has a first-order filter."""

from ._candidate import Candidate, Free, Rig, of_sensors, starts_of
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor, the drive's too."""
    return [
        Candidate(free, starts_of(free, 2.0), channel)
        for channel, _ in of_sensors(rig, drive=True)
        for free in [(Free(f"filter.{channel}", 0.0, 1e-3, 0.0, 0.2),)]
    ]


effect = Effect(
    name="sensor_filter",
    place="sensor",
    summary="first-order filter in a sensor",
    fingerprint="one channel is late and smooth against all others",
    sensor="filter",
    candidates=candidates,
    source="definition",
)
