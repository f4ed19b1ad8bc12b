"""A cause as it is drawn: how it changes the bench, over which sizes, and as which ids it counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from rig import Rig
from sensors import Sensors

Names = tuple[tuple[str, str | None], ...]


@dataclass(frozen=True)
class Bench:
    """The rig and its sensors: what an effect changes."""

    rig: Rig
    sensors: Sensors = field(default_factory=Sensors)

    def rigged(self, **changes: float) -> Bench:
        return replace(self, rig=self.rig._replace(**changes))

    def sensed(self, kind: str, channel: str, size: float) -> Bench:
        return replace(self, sensors=replace(self.sensors, **{kind: {**getattr(self.sensors, kind), channel: size}}))


@dataclass(frozen=True)
class Conditions:
    """What a draw may look at: the log of the bench without the effect, and the spring it works against."""

    rng: np.random.Generator
    samples: np.ndarray
    K_S: float

    @property
    def reach(self) -> float:
        return float(np.max(np.abs(self.samples[:, 3])))


@dataclass(frozen=True)
class Effect:
    """One cause, drawn.

    apply: (bench, size) -> bench with it; sizes run from `smallest` to `largest`, both positive.
    value: size -> what the contract's parameters then are.
    counts_as: ids (with channel) that are the same in principle under this law, itself apart.
    """

    id: str
    law: str
    apply: Callable[[Bench, float], Bench]
    smallest: float
    largest: float
    value: Callable[[Bench], dict[str, float]]
    channel: str | None = None
    counts_as: Names = ()

    @property
    def accepted(self) -> Names:
        return ((self.id, self.channel), *self.counts_as)


def sign(c: Conditions) -> float:
    """+1 or -1."""
    return float(c.rng.choice([-1.0, 1.0]))


def times(
    name: str, id: str, law: str, direction: float, low: float, high: float, *more: str, also: Names = ()
) -> Effect:
    """Parameters multiplied by exp(+-size)."""
    names = (name, *more)

    def apply(b: Bench, s: float) -> Bench:
        return b.rigged(**{n: getattr(b.rig, n) * float(np.exp(direction * s)) for n in names})

    return Effect(id, law, apply, low, high, lambda b: {n: getattr(b.rig, n) for n in names}, counts_as=also)


def put(
    id: str,
    law: str,
    name: str,
    low: float,
    high: float,
    *,
    direction: float = 1.0,
    also: Names = (),
    label: str = "",
    **fixed: float,
) -> Effect:
    """One number of the rig set to +-size, others fixed beside it."""

    def apply(b: Bench, s: float) -> Bench:
        return b.rigged(**{name: direction * s, **fixed})

    return Effect(id, law, apply, low, high, lambda b: {label or name: getattr(b.rig, name)}, counts_as=also)


def pick(c: Conditions, *laws: str) -> tuple[str, float]:
    """One of the laws, and its number in the rig."""
    k = int(c.rng.integers(len(laws)))
    return laws[k], float(k)
