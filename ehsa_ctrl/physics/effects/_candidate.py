"""Candidate effects of a diagnosis: the numbers to estimate, their range, and the starting points of the search.

An effect with one number that starts at neutral, or one that is a wrong parameter of the plant, needs nothing of this.
An effect whose starting point depends on the log (a valve that opens somewhat below the highest pressure, a bump of
friction at one of several positions) has a function `candidates` that reads the log.
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

#: The smallest change of a pressure that a log shows [Pa]: about the noise of the bench's sensors.
PRESSURE_SCALE = 1e4

Starts = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class FreeNumber:
    """A number that a hypothesis estimates.

    nominal: nominal (or neutral) value. scale: size of a change that a log shows. lower, upper: bounds.
    fixed: the number keeps its starting value; it has no standard deviation.
    """

    name: str
    nominal: float
    scale: float
    lower: float = -inf
    upper: float = inf
    fixed: bool = False


@dataclass(frozen=True)
class CandidateEffect:
    """An effect with the numbers to estimate.

    free: its numbers; the first one measures the size. starts: starting points of the search; several if the cost may
    have several minima. channel: for a sensor error.
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
        """Id and channel, which a diagnosis reports as one cause."""
        return self.id, self.channel

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(number.name for number in self.free)

    @property
    def shaped(self) -> bool:
        """Whether further numbers are a location or shape, which has no effect while the first number is zero.

        Not where the first one is infinite without the effect: no secant leads there.
        """
        shapes = any(p.shape for p in self.effect.parameters if p.name in self.names)
        return shapes and isfinite(self.free[0].nominal)


@dataclass(frozen=True)
class DiagnosisContext:
    """The nominal plant and the log, as candidates of effects use them.

    log: the measured log.
    channels: channels of the log that a simulation has too, including the load cell.
    slopes: channels that are scored by their slope.
    outputs: channel -> state that it measures.
    drive: channel of the first input.
    values: symbol -> value of the plant's parameters.
    own_name: symbol in the catalogue of effects -> the plant's name.
    needed: names on which a simulation depends.
    bounds: name -> lowest and highest value.
    effort: size of the efforts of rod or shaft, relative to the EHSA, for which the smallest changes are stated.
    sensors: channel -> nominal setting -> value.
    switches_law: whether a hypothesis may use another friction law.
    friction_levels: symbol -> friction or offset that the balances of a plant without dry friction show.
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
        """Value of a parameter; 0 if the plant lacks it."""
        return self.values.get(self.own_name(symbol), 0.0)

    def plant_parameter(
        self, symbol: str, relative: float, smallest: float = 0.0, scale: float | None = None
    ) -> FreeNumber:
        """A parameter of the plant as a free number.

        scale: of the number; by default `relative` times its value, or `smallest` for a value near zero.
        """
        name = self.own_name(symbol)
        value, smallest = self.values[name], smallest * self.effort
        scale = relative * abs(value) if scale is None else scale
        return FreeNumber(name, value, smallest if scale < 0.1 * smallest else scale, *self.bounds[name])


def measured(context: DiagnosisContext, *states: str) -> list[np.ndarray]:
    """Logged outputs (N,) that measure these states; those that the log lacks are left out."""
    channels = {state: channel for channel, state in context.outputs.items() if channel in context.log.channels}
    return [context.log[channels[state]] for state in states if state in channels]


def starting_points(free: Sequence[FreeNumber], *sizes: float) -> Starts:
    """Starts with the first number moved by each of `sizes` scales, the others at their nominal values."""
    return tuple((free[0].nominal + s * free[0].scale, *(f.nominal for f in free[1:])) for s in sizes)


def effect_number(effect: Effect, context: DiagnosisContext, name: str, scale: float) -> FreeNumber:
    """A parameter of an effect as a free number, within its bounds for a search or up to the plant's own value."""
    parameter, own = effect.parameter(name), context.value(name)
    if parameter.search is None:
        return FreeNumber(name, own, scale, parameter.lower, parameter.upper)
    lower, upper = parameter.search
    return FreeNumber(name, own, scale, min(lower, own), max(upper, own))


def from_neutral(effect: Effect, context: DiagnosisContext, *others: FreeNumber) -> list[CandidateEffect]:
    """Candidates with the effect's first number, started near neutral: alone, and together with `others` if given."""
    first = effect.parameters[0]
    free = (effect_number(effect, context, first.name, first.scale),)
    starts = starting_points(free, *((1.0, 8.0) if free[0].lower == 0.0 else (0.0,)))
    found = [CandidateEffect(effect, free, starts)]
    if others:
        nominal = tuple(other.nominal for other in others)
        found.append(CandidateEffect(effect, (*free, *others), tuple((*start, *nominal) for start in starts)))
    return found


def from_levels(effect: Effect, free: FreeNumber, levels: Sequence[float], *others: FreeNumber) -> CandidateEffect:
    """Candidate with a threshold as free number, started from each of `levels` and from the plant's own if finite.

    Its nominal value is the neutral one, infinity, because the derivatives vanish if the threshold is never reached.
    """
    known = [free.nominal] if isfinite(free.nominal) else []
    starts = tuple((level, *(other.nominal for other in others)) for level in [*levels, *known])
    neutral = replace(free, nominal=effect.parameter(free.name).neutral)
    return CandidateEffect(effect, (neutral, *others), starts)


def from_symbols(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Candidates with the effect's plant parameters: one with all of them, or one for each of its groups."""
    found = []
    for group in effect.groups or (tuple(symbol for symbol in effect.symbols if context.simulated(symbol)),):
        if group and all(context.simulated(symbol) for symbol in group):
            free = tuple(
                context.plant_parameter(symbol, 0.1, effect.symbols[symbol], effect.wear_scales.get(symbol))
                for symbol in group
            )
            starts = starting_points(free, 0.0)
            if effect.from_balances and free[0].nominal == 0.0:
                # Started from the level in the balances: a missing friction is too large for derivatives at zero.
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
    """Candidates with a setting of one sensor each, started at `size` scales.

    free_number: (channel, standard deviation of its readings) -> the number. drive: include the sensor of the drive.
    The load cell is left out, because its reading affects no scored signal.
    """
    channels = [channel for channel in context.channels if channel != "force"] + ([context.drive] if drive else [])
    found = []
    for channel in channels:
        sd = float(np.std(context.log[channel]))
        if sd > 0.0:
            free = (free_number(channel, sd),)
            found.append(CandidateEffect(effect, free, starting_points(free, size), channel))
    return found
