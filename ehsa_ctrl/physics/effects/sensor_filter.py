"""A sensor has a first-order filter."""

from ._effect import Effect

effect = Effect(
    name="sensor_filter",
    place="sensor",
    summary="first-order filter in a sensor",
    fingerprint="one channel is late and smooth against all others",
    sensor="filter",
    source="definition",
)
