"""A drawn effect: how it changes the bench, its range of sizes, and the ids it counts as."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from equivalent_ids import Names
from rig import Rig
from sensors import Sensors


@dataclass(frozen=True)
class Bench:
    """The rig and its sensors."""

    rig: Rig
    sensors: Sensors = field(default_factory=Sensors)

    def with_rig(self, **changes: float) -> Bench:
        return replace(self, rig=self.rig._replace(**changes))

    def with_sensor(self, kind: str, channel: str, size: float) -> Bench:
        return replace(self, sensors=replace(self.sensors, **{kind: {**getattr(self.sensors, kind), channel: size}}))


@dataclass(frozen=True)
class Conditions:
    """Inputs of a draw: the samples of the bench without the effect, and the spring."""

    rng: np.random.Generator
    samples: np.ndarray
    K_S: float

    @property
    def reach(self) -> float:
        return float(np.max(np.abs(self.samples[:, 3])))


@dataclass(frozen=True)
class Effect:
    """One drawn effect.

    apply: (bench, size) -> bench with it; sizes run from `smallest` to `largest`, both positive.
    value: bench -> the contract's parameters.
    counts_as: other ids (with channel) that are equivalent under this law.
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


def random_sign(c: Conditions) -> float:
    """+1 or -1."""
    return float(c.rng.choice([-1.0, 1.0]))


def scale_parameter(
    name: str, id: str, law: str, direction: float, low: float, high: float, *more: str, also: Names = ()
) -> Effect:
    """Parameters multiplied by exp(+-size)."""
    names = (name, *more)

    def apply(b: Bench, s: float) -> Bench:
        return b.with_rig(**{n: getattr(b.rig, n) * float(np.exp(direction * s)) for n in names})

    return Effect(id, law, apply, low, high, lambda b: {n: getattr(b.rig, n) for n in names}, counts_as=also)


def set_parameter(
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
    """One parameter of the rig set to +-size, and others to fixed values."""

    def apply(b: Bench, s: float) -> Bench:
        return b.with_rig(**{name: direction * s, **fixed})

    return Effect(id, law, apply, low, high, lambda b: {label or name: getattr(b.rig, name)}, counts_as=also)


def choose_law(c: Conditions, *laws: str) -> tuple[str, float]:
    """One of the laws, and its number in the rig."""
    k = int(c.rng.integers(len(laws)))
    return laws[k], float(k)
