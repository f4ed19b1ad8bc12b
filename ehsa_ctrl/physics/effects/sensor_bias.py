"""A sensor reads a constant too much."""

from ._candidate import Candidate, Free, Rig, from_sensors
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Every sensor; the rod's place is defined by its own, so that only a load that depends on it could tell."""

    def bias(channel: str, sd: float) -> Free:
        return Free(f"bias.{channel}", rig.sensor(channel, "bias"), 0.03 * sd, -20.0 * sd, 20.0 * sd)

    return [c for c in from_sensors(rig, bias) if c.channel != "position" or rig.value("K_S") != 0.0]


effect = Effect(
    name="sensor_bias",
    place="sensor",
    summary="constant error of a sensor",
    fingerprint="one channel is off by a constant, the balances without it are sound",
    sensor="bias",
    candidates=candidates,
    source="definition",
)
