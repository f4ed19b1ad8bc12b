"""A sensor's scale is wrong."""

from ._effect import Effect

effect = Effect(
    name="sensor_scale",
    place="sensor",
    summary="wrong scale of a sensor",
    fingerprint="one channel is off in proportion to itself",
    sensor="scale",
    source="definition",
)
