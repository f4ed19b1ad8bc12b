"""Sensor effects."""

from __future__ import annotations

from cause import Conditions, Effect, random_sign
from equivalent_ids import equivalents
from sensors import CHANNELS


def draw_sensor(c: Conditions, id: str) -> Effect:
    rng = c.rng
    if id == "sensor_bias":
        channel = str(rng.choice(["speed", "p1", "p2", "current"]))
        low, high = {"speed": (0.3, 60.0), "current": (0.003, 0.3)}.get(channel, (5e3, 4e5))
        kind, to = "bias", lambda s: way * s
    elif id == "sensor_scale":
        channel = str(rng.choice(["speed", "p1", "p2", "position", "current"]))
        low, high = 0.004, 0.2
        kind, to = "scale", lambda s: 1.0 + way * s
    else:
        channel = str(rng.choice(CHANNELS[:4]))
        low, high = 3e-4, 0.03
        kind, to = ("delay" if id == "sensor_delay" else "lag"), lambda s: s
    way = random_sign(c)
    return Effect(
        id, channel, lambda b, s: b.with_sensor(kind, channel, to(s)), low, high,
        lambda b: {"value": getattr(b.sensors, kind)[channel]}, channel, equivalents(id, channel),
    )  # fmt: skip


def sensor_filter(channel: str) -> Effect:
    """A first-order filter of one channel; the size is its time constant [s]."""
    return Effect(
        "sensor_filter", channel, lambda b, s: b.with_sensor("lag", channel, s), 3e-4, 0.03,
        lambda b: {"value": b.sensors.lag[channel]}, channel,
    )  # fmt: skip
