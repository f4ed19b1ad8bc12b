"""A sensor reads a constant too much."""

from ._effect import Effect

effect = Effect(
    name="sensor_bias",
    place="sensor",
    summary="constant error of a sensor",
    fingerprint="one channel is off by a constant, the balances without it are sound",
    sensor="bias",
    source="definition",
)
