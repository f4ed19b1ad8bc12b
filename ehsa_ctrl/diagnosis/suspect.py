"""One who may have done it: what becomes free, from which values the search starts, within which bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from .twin import Twin

#: Leakage wears by factors and not by per cents.
WEARS = {"K_L": 5e-13}


@dataclass(frozen=True)
class Free:
    """One number that a hypothesis sets free: its neutral or believed value, a size that is felt, bounds."""

    name: str
    believed: float
    scale: float
    lower: float = -inf
    upper: float = inf


@dataclass(frozen=True)
class Suspect:
    """One effect, with a channel if it is a sensor's.

    free: what it sets free, the size first. starts: values of these from which a search begins, several where the way
    from one to another is not downhill.
    """

    id: str
    place: str
    free: tuple[Free, ...]
    starts: tuple[tuple[float, ...], ...]
    channel: str | None = None

    @property
    def key(self) -> tuple[str, str | None]:
        return self.id, self.channel

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(free.name for free in self.free)

    def __str__(self) -> str:
        return self.id if self.channel is None else f"{self.id}({self.channel})"


def starts_of(free: Sequence[Free], *sizes: float) -> tuple[tuple[float, ...], ...]:
    """Starts with the first number moved by each of `sizes` scales, the others as believed."""
    return tuple((free[0].believed + s * free[0].scale, *(f.believed for f in free[1:])) for s in sizes)


def letter_of(twin: Twin, name: str, relative: float, typical: float = 0.0) -> Free:
    """A letter of the plant: its bounds are physical, its scale a share of itself or `typical` where it is zero."""
    name = twin.plant.structure.system.own(name)
    value = twin.plant[name]
    kinds = {kind.name: kind for kind in twin.plant.structure.equations.parameters}
    lower = kinds[name].lower
    scale = WEARS.get(name, relative * abs(value))
    # A value that is next to nothing is as far from what it should be as nothing is.
    scale = typical if scale < 0.1 * typical else scale
    if kinds[name].lower_open and lower == 0.0:
        lower = 0.02 * value
    return Free(name, value, scale, lower, kinds[name].upper)
