"""A sensor's scale is wrong."""

from ._candidate import Candidate, Free, Rig, of_sensors, starts_of
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor that a simulation has too."""
    return [
        Candidate(free, starts_of(free, 0.0), channel)
        for channel, _ in of_sensors(rig)
        for free in [(Free(f"scale.{channel}", rig.sensor(channel, "scale"), 0.02, 0.2, 5.0),)]
    ]


effect = Effect(
    name="sensor_scale",
    place="sensor",
    summary="wrong scale of a sensor",
    fingerprint="one channel is off in proportion to itself",
    sensor="scale",
    candidates=candidates,
    source="definition",
)
