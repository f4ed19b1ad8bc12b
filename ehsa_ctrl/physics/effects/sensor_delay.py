"""A sensor's reading is late by a constant time."""

from ._candidate import Candidate, Free, Rig, of_sensors, starts_of
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor, the drive's too. Those of slow logs may have clocks of their own."""
    dt = rig.sample_time
    return [
        Candidate(free, starts_of(free, 2.0), channel)
        for channel, _ in of_sensors(rig, drive=True)
        for free in [(Free(f"delay.{channel}", 0.0, max(1e-3, 0.25 * dt), 0.0, max(0.1, 25.0 * dt)),)]
    ]


effect = Effect(
    name="sensor_delay",
    place="sensor",
    summary="late reading of a sensor",
    fingerprint="one channel comes late against all others",
    sensor="delay",
    candidates=candidates,
    source="definition",
)
