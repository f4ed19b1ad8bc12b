"""A sensor's scale is wrong."""

from ._candidate import Candidate, Free, Rig, from_sensors
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor that a simulation has too."""
    return from_sensors(rig, lambda channel, _: Free(f"scale.{channel}", rig.sensor(channel, "scale"), 0.02, 0.2, 5.0))


effect = Effect(
    name="sensor_scale",
    place="sensor",
    summary="wrong scale of a sensor",
    fingerprint="one channel is off in proportion to itself",
    sensor="scale",
    candidates=candidates,
    source="definition",
)
