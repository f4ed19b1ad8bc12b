"""How an effect becomes free in a diagnosis: which of its numbers, by how much, and where a log says to begin.

Most effects have one number that goes from neutral to where it is felt, or are numbers of the plant that may be wrong;
these need not say anything. An effect whose beginning depends on the log (a valve somewhat below the highest pressure,
a bump of friction at one of several places) brings a function `candidates` that asks the rig.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from ._effect import Effect

#: What is felt of a pressure, at least [Pa].
FELT_PRESSURE = 1e4

Starts = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Free:
    """One number that a hypothesis sets free: its neutral or believed value, a size that is felt, bounds.

    fixed: as good as given by the start; it has no deviation of its own.
    """

    name: str
    nominal: float
    scale: float
    lower: float = -inf
    upper: float = inf
    fixed: bool = False


@dataclass(frozen=True)
class Candidate:
    """One way to set an effect free.

    free: the numbers, the size first. starts: values of these from which a search begins, several where the way from
    one to another is not downhill. channel: of a sensor's effect.
    """

    free: tuple[Free, ...]
    starts: Starts
    channel: str | None = None


class Rig(Protocol):
    """What an effect may ask of the believed plant and of the log.

    channels: of the log that a simulation has too, the load cell among them. drive: the channel of the drive.
    sample_time: s.
    """

    @property
    def channels(self) -> tuple[str, ...]: ...

    @property
    def drive(self) -> str: ...

    @property
    def sample_time(self) -> float: ...

    def shows(self, symbol: str) -> bool:
        """Whether a simulation depends on a symbol of the plant or a number of an effect."""
        ...

    def value(self, symbol: str) -> float:
        """A number of the plant by its symbol in the catalogue; 0 where the plant has none."""
        ...

    def symbol(self, symbol: str, relative: float, felt: float = 0.0) -> Free:
        """A symbol of the plant as a free number: its scale is a share of itself, or `felt` where it is next to 0."""
        ...

    def measured(self, channel: str) -> np.ndarray | None:
        """A channel of the log (N,); None where it has none."""
        ...

    def sensor(self, channel: str, word: str) -> float:
        """What is believed of a channel's sensor: its bias or its scale."""
        ...

    def dry_friction(self) -> Mapping[str, float]:
        """Levels of friction that the balances show where the plant has none, by symbol."""
        ...

    def ripples(self) -> Sequence[tuple[float, float, float]]:
        """(periods a turn, amplitude [N m], phase [rad]) of the torque's strongest ripples over the shaft's angle."""
        ...

    def yields(self) -> bool:
        """Whether the rod may stand on bristles in a simulation."""
        ...


def starts_of(free: Sequence[Free], *sizes: float) -> Starts:
    """Starts with the first number moved by each of `sizes` scales, the others as believed."""
    return tuple((free[0].nominal + s * free[0].scale, *(f.nominal for f in free[1:])) for s in sizes)


def number(effect: Effect, rig: Rig, name: str, scale: float) -> Free:
    """A number of an effect within its own bounds."""
    kind = effect.parameter(name)
    return Free(name, rig.value(name), scale, kind.lower, kind.upper)


def from_neutral(effect: Effect, rig: Rig) -> list[Candidate]:
    """The first number from neutral to where it is felt."""
    first = effect.parameters[0]
    lower, upper = first.search or (first.lower, first.upper)
    free = (Free(first.name, rig.value(first.name), first.scale, lower, upper),)
    return [Candidate(free, starts_of(free, *((1.0, 8.0) if lower == 0.0 else (0.0,))))]


def with_another(effect: Effect, rig: Rig, other: Free) -> list[Candidate]:
    """From neutral, alone and together with another number."""
    (alone,) = from_neutral(effect, rig)
    both = (*alone.free, other)
    return [alone, Candidate(both, tuple((*start, other.nominal) for start in alone.starts))]


def from_levels(effect: Effect, free: Free, levels: Sequence[float], *others: Free) -> Candidate:
    """A level beyond which something happens, searched from each of `levels` and from the plant's own if it has one.

    Neutral is infinitely far, also for a plant that has one: where it is never reached its derivatives vanish.
    """
    known = [free.nominal] if isfinite(free.nominal) else []
    starts = tuple((level, *(other.nominal for other in others)) for level in [*levels, *known])
    return Candidate((replace(free, nominal=effect.parameter(free.name).neutral), *others), starts)


def from_symbols(effect: Effect, rig: Rig) -> list[Candidate]:
    """Symbols of the plant that may be wrong: all together, or each of the effect's groups by itself."""
    found = []
    for group in effect.groups or (tuple(symbol for symbol in effect.symbols if rig.shows(symbol)),):
        if group and all(rig.shows(symbol) for symbol in group):
            free = tuple(rig.symbol(symbol, 0.1, effect.symbols[symbol]) for symbol in group)
            starts = starts_of(free, 0.0)
            if effect.from_balances and free[0].nominal == 0.0:
                # From none to all of it is too far for derivatives at none.
                seen = rig.dry_friction().get(group[0], 0.0)
                starts = ((seen, *(0.1 * seen for _ in group[1:])),) if seen else starts
            found.append(Candidate(free, starts))
    return found


def from_sensors(
    rig: Rig, free_of: Callable[[str, float], Free], size: float = 0.0, *, drive: bool = False
) -> list[Candidate]:
    """A number of each sensor that may be wrong, moved by `size` scales; with `drive` the drive's sensor too.

    free_of: channel and the standard deviation of its readings -> the number. What the load cell shows moves none of
    the signals that are scored.
    """
    channels = [channel for channel in rig.channels if channel != "force"] + ([rig.drive] if drive else [])
    found = []
    for channel in channels:
        y = rig.measured(channel)
        if y is not None and np.std(y) > 0.0:
            free = (free_of(channel, float(np.std(y))),)
            found.append(Candidate(free, starts_of(free, size), channel))
    return found
