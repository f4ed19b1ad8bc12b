"""A sensor's reading is late by a constant time."""

from ._candidate import Candidate, Free, Rig, from_sensors
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor, the drive's too. Those of slow logs may have clocks of their own."""
    size, longest = max(1e-3, 0.25 * rig.sample_time), max(0.1, 25.0 * rig.sample_time)
    return from_sensors(rig, lambda channel, _: Free(f"delay.{channel}", 0.0, size, 0.0, longest), 2.0, drive=True)


effect = Effect(
    name="sensor_delay",
    place="sensor",
    summary="late reading of a sensor",
    fingerprint="one channel comes late against all others",
    sensor="delay",
    candidates=candidates,
    source="definition",
)
