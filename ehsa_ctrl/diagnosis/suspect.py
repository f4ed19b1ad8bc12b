"""One who may have done it: what becomes free, from which values the search starts, within which bounds."""

from __future__ import annotations

from dataclasses import dataclass

from ..physics.effects import EFFECTS, Free


def wears() -> dict[str, float]:
    """Symbols that change by factors and not by per cents, and the size of a change."""
    return {symbol: size for effect in EFFECTS.values() for symbol, size in effect.wears.items()}


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

    @property
    def shaped(self) -> bool:
        """Whether other numbers than the first say where or how, so that they mean nothing while the first is zero."""
        return any(p.shape for p in EFFECTS[self.id].parameters if p.name in self.names)

    def __str__(self) -> str:
        return self.id if self.channel is None else f"{self.id}({self.channel})"
