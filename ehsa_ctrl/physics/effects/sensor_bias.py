"""A sensor reads a constant too much."""

from ._candidate import Candidate, Free, Rig, of_sensors, starts_of
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor; the rod's place is defined by its own, so that only a load that depends on it could tell."""
    return [
        Candidate(free, starts_of(free, 0.0), channel)
        for channel, sd in of_sensors(rig)
        if channel != "position" or rig.value("K_S") != 0.0
        for free in [(Free(f"bias.{channel}", rig.sensor(channel, "bias"), 0.03 * sd, -20.0 * sd, 20.0 * sd),)]
    ]


effect = Effect(
    name="sensor_bias",
    place="sensor",
    summary="constant error of a sensor",
    fingerprint="one channel is off by a constant, the balances without it are sound",
    sensor="bias",
    candidates=candidates,
    source="definition",
)
