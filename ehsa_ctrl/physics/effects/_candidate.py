"""How a diagnosis sets an effect free: which numbers, over which range, and from which values a search starts.

An effect with one number that goes from neutral to a size that a log shows, or one that is a wrong parameter of the
plant, needs nothing of this. An effect whose starting point depends on the log (a valve that opens somewhat below the
highest pressure, a bump of friction at one of several positions) brings a function `candidates` that reads the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from ...core.log import Log

if TYPE_CHECKING:
    from ._effect import Effect

#: The smallest change of a pressure that a log shows [Pa].
PRESSURE_SCALE = 1e4

Starts = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class FreeNumber:
    """One number that a hypothesis sets free: nominal (or neutral) value, size of a change that a log shows, bounds.

    fixed: set by the start and not refined; it has no standard deviation of its own.
    """

    name: str
    nominal: float
    scale: float
    lower: float = -inf
    upper: float = inf
    fixed: bool = False


@dataclass(frozen=True)
class CandidateEffect:
    """One way to set an effect free.

    free: its numbers, the size first. starts: values of these from which a search starts; several where the path from
    one to another is not downhill. channel: of a sensor's effect.
    """

    effect: Effect
    free: tuple[FreeNumber, ...]
    starts: Starts
    channel: str | None = None

    @property
    def id(self) -> str:
        return self.effect.name

    @property
    def key(self) -> tuple[str, str | None]:
        """Id and channel: what a diagnosis reports as one cause."""
        return self.id, self.channel

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(number.name for number in self.free)

    @property
    def shaped(self) -> bool:
        """Whether numbers beyond the first give a location or shape, which means nothing while the first is zero."""
        return any(p.shape for p in self.effect.parameters if p.name in self.names)


@dataclass(frozen=True)
class DiagnosisContext:
    """What an effect may ask about the nominal plant and the log.

    log: the measured log. channels: those of the log that a simulation has too, the load cell among them. slopes: those
    that are scored by their slope. outputs: channel -> state that it measures. drive: the channel of the first input.
    values: the plant's parameters. own_name: symbol in the catalogue -> the plant's name. needed: names on which a
    simulation depends. bounds: name -> lowest and highest value. effort: the rod's efforts in units of those for which
    smallest changes are stated. sensors: channel -> nominal setting -> value. switches_law: whether a hypothesis may
    use another friction law. friction_levels: friction and offset that the balances show of a plant without dry
    friction, by symbol.
    """

    log: Log
    channels: tuple[str, ...]
    slopes: frozenset[str]
    outputs: Mapping[str, str]
    drive: str
    values: Mapping[str, float]
    own_name: Callable[[str], str]
    needed: frozenset[str]
    bounds: Mapping[str, tuple[float, float]]
    effort: float
    sensors: Mapping[str, Mapping[str, float]]
    switches_law: bool
    friction_levels: Mapping[str, float]

    def simulated(self, symbol: str) -> bool:
        """Whether a simulation depends on a parameter."""
        return self.own_name(symbol) in self.needed

    def value(self, symbol: str) -> float:
        """A parameter; 0 where the plant has none."""
        return self.values.get(self.own_name(symbol), 0.0)

    def plant_parameter(
        self, symbol: str, relative: float, smallest: float = 0.0, scale: float | None = None
    ) -> FreeNumber:
        """A parameter of the plant as a free number.

        Its scale is `scale`, or a share of itself; of a value near zero, which is as uncertain as zero, `smallest`.
        """
        name = self.own_name(symbol)
        value, smallest = self.values[name], smallest * self.effort
        scale = relative * abs(value) if scale is None else scale
        return FreeNumber(name, value, smallest if scale < 0.1 * smallest else scale, *self.bounds[name])


def measured(context: DiagnosisContext, *states: str) -> list[np.ndarray]:
    """Logged outputs (N,) that measure these states, as far as the log has them."""
    channels = {state: channel for channel, state in context.outputs.items() if channel in context.log.channels}
    return [context.log[channels[state]] for state in states if state in channels]


def starting_points(free: Sequence[FreeNumber], *sizes: float) -> Starts:
    """Starts with the first number moved by each of `sizes` scales, the others at their nominal values."""
    return tuple((free[0].nominal + s * free[0].scale, *(f.nominal for f in free[1:])) for s in sizes)


def effect_number(effect: Effect, context: DiagnosisContext, name: str, scale: float) -> FreeNumber:
    """A number of an effect within its own bounds."""
    parameter = effect.parameter(name)
    return FreeNumber(name, context.value(name), scale, parameter.lower, parameter.upper)


def from_neutral(effect: Effect, context: DiagnosisContext, *others: FreeNumber) -> list[CandidateEffect]:
    """The first number from neutral to a size that a log shows: alone, and together with `others` if there are any."""
    first = effect.parameters[0]
    lower, upper = first.search or (first.lower, first.upper)
    free = (FreeNumber(first.name, context.value(first.name), first.scale, lower, upper),)
    starts = starting_points(free, *((1.0, 8.0) if lower == 0.0 else (0.0,)))
    found = [CandidateEffect(effect, free, starts)]
    if others:
        nominal = tuple(other.nominal for other in others)
        found.append(CandidateEffect(effect, (*free, *others), tuple((*start, *nominal) for start in starts)))
    return found


def from_levels(effect: Effect, free: FreeNumber, levels: Sequence[float], *others: FreeNumber) -> CandidateEffect:
    """A threshold that is searched from each of `levels`, and from the plant's own if it has one.

    Neutral is infinite, also for a plant that has the effect: where the threshold is never reached derivatives vanish.
    """
    known = [free.nominal] if isfinite(free.nominal) else []
    starts = tuple((level, *(other.nominal for other in others)) for level in [*levels, *known])
    neutral = replace(free, nominal=effect.parameter(free.name).neutral)
    return CandidateEffect(effect, (neutral, *others), starts)


def from_symbols(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Parameters of the plant that may be wrong: all together, or each of the effect's groups by itself."""
    found = []
    for group in effect.groups or (tuple(symbol for symbol in effect.symbols if context.simulated(symbol)),):
        if group and all(context.simulated(symbol) for symbol in group):
            free = tuple(
                context.plant_parameter(symbol, 0.1, effect.symbols[symbol], effect.wears.get(symbol))
                for symbol in group
            )
            starts = starting_points(free, 0.0)
            if effect.from_balances and free[0].nominal == 0.0:
                # The whole of a missing friction is too far away for derivatives at zero.
                level = context.friction_levels.get(group[0], 0.0)
                starts = ((level, *(0.1 * level for _ in group[1:])),) if level else starts
            found.append(CandidateEffect(effect, free, starts))
    return found


def from_sensors(
    effect: Effect,
    context: DiagnosisContext,
    free_number: Callable[[str, float], FreeNumber],
    size: float = 0.0,
    *,
    drive: bool = False,
) -> list[CandidateEffect]:
    """A number of each sensor that may be wrong, moved by `size` scales; with `drive` of the drive's sensor too.

    free_number: channel and standard deviation of its readings -> the number. The load cell is left out: what it reads
    changes none of the scored signals.
    """
    channels = [channel for channel in context.channels if channel != "force"] + ([context.drive] if drive else [])
    found = []
    for channel in channels:
        sd = float(np.std(context.log[channel]))
        if sd > 0.0:
            free = (free_number(channel, sd),)
            found.append(CandidateEffect(effect, free, starting_points(free, size), channel))
    return found
