"""A sensor's reading is late by a constant time."""

from ._effect import Effect

effect = Effect(
    name="sensor_delay",
    place="sensor",
    summary="late reading of a sensor",
    fingerprint="one channel comes late against all others",
    sensor="delay",
    source="definition",
)
