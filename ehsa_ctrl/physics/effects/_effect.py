"""The definition of an effect: behaviour of a real rig that (12) lacks, switched on by name.

An effect's file contains everything about it: equations, parameters, its signature in a log, which of its parameters a
diagnosis estimates, and which other effects no log can distinguish from it.

An effect changes signals of the plant, each with one function. The function takes the old value of the signal, and
states, inputs, parameters and other signals, all by their names. At neutral parameters it returns the old value, to the
last bit. An effect may add states, whose rates are zero at neutral parameters. Some effects have no equation: a wrong
parameter of the plant, a sensor error, or another friction law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from ...core.log import Log
from ._candidate import CandidateEffect, DiagnosisContext, from_neutral, from_symbols

if TYPE_CHECKING:
    from ._law_file import EffectExpression

PLACES = ("torque", "drive", "flow", "force", "sensor")


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    Attributes
    ----------
    name, unit, meaning: as in tables.
    neutral: value at which the effect is absent (may be infinite).
    typical: default for a plant that switches the effect on.
    lower, upper: physical bounds.
    source: source of `typical`.
    detectable: size of a change that a log shows; by default a tenth of the way from neutral to typical.
    search: bounds for the search of a diagnosis, if narrower than the physical ones.
    shape: whether it is a location or shape, which has no effect while the first parameter is neutral.
    negligible: of an effect's first parameter, distance from neutral up to which a diagnosis simulates without the
        effect: no log shows it, and its equations are stiff there.
    """

    name: str
    unit: str
    meaning: str
    neutral: float
    typical: float
    lower: float
    upper: float = inf
    source: str = "assumed"
    detectable: float | None = None
    search: tuple[float, float] | None = None
    shape: bool = False
    negligible: float = 0.0

    @property
    def scale(self) -> float:
        """Size of a change that a log shows."""
        return self.detectable if self.detectable is not None else 0.1 * abs(self.typical - self.neutral)

    def is_negligible(self, value: float) -> bool:
        """Whether a diagnosis simulates without the effect at this value of its first parameter."""
        return self.negligible > 0.0 and abs(value - self.neutral) <= self.negligible


@dataclass(frozen=True)
class EffectState:
    """A state that an effect adds; its rate is the signal NAME_dot of the effect. scale: as in `plant.system.State`.

    In a run that starts in motion, its initial value is zero, or that of the input `starts_at`, or that of `along`
    (log, plant's parameters -> (N,)) at the sample. Balances of a log take its course from `along`.
    """

    name: str
    unit: str
    scale: float
    starts_at: str | None = None
    along: Callable[[Log, Mapping[str, float]], np.ndarray] | None = None


@dataclass(frozen=True)
class MeasuredReplay:
    """How a simulation applies an effect along a measured signal instead of the simulated one.

    channel: channel that `prepare` adds to a log.
    prepare: plant's parameters, log, reference log or None -> the log with the channel, in phase with the reference.
    drive: parameters, log with the channel -> (N,) addition to the first input, in its unit.
    symbols: parameters on which `drive` depends.
    """

    channel: str
    prepare: Callable[[Mapping[str, float], Log, Log | None], Log]
    drive: Callable[[Mapping[str, float], Log], np.ndarray]
    symbols: tuple[str, ...]


@dataclass(frozen=True)
class LawSwitch:
    """How a hypothesis replaces the friction law of the rod.

    law: the other law.
    number: free number of a hypothesis, the reciprocal of the law's `parameter`, so that zero is the plant without the
        effect; the law replaces the plant's if the number exceeds `threshold`.
    reported: the parameter's name in results.
    defaults: further parameter of the law -> its value as a function of that number and the plant's parameters.
    state: the law's state.
    deflection: initial value of the state per unit of compliance; arguments are states and parameters by name.
    """

    law: str
    number: str
    parameter: str
    reported: str
    threshold: float
    defaults: Mapping[str, Callable[[float, Mapping[str, float]], float]]
    state: str
    deflection: Callable[..., float]

    def active(self, values: Mapping[str, float]) -> bool:
        """Whether a hypothesis with these values uses the law."""
        return values.get(self.number, 0.0) > self.threshold

    def parameters(self, values: Mapping[str, float], plant: Mapping[str, float]) -> dict[str, float]:
        """The law's parameters under a hypothesis."""
        number = values[self.number]
        defaults = {name: values.get(name, default(number, plant)) for name, default in self.defaults.items()}
        return {self.parameter: 1.0 / number, **defaults}


@dataclass(frozen=True, eq=False)
class Effect:
    """An effect: where it acts, what it changes and how a log shows it.

    Effects are compared by identity, because two projects may have different effects of one name.

    Attributes
    ----------
    name: its id in plants, lists and diagnoses.
    place: the balance that it disturbs, one of PLACES.
    summary: one line for lists.
    fingerprint: its signature in a log.
    changes: signal -> function that returns its new value.
    parameters: in the order of importance; the first one measures the size of the effect.
    states: states that it adds.
    adds: signal -> function, for the rates of its states. `asked_current` is the current before any effect.
    symbols: plant parameters whose wrong value is the effect -> size of a change that a log shows if the nominal value
        is zero.
    groups: symbols that a diagnosis estimates together; by default all of them.
    wear_scales: symbol -> size of a change, for parameters that wear changes by orders of magnitude.
    related_symbols: further plant parameters that are reported under this effect.
    from_balances: whether the search for a plant that lacks it starts from the level that its balances show.
    sensor: setting of a sensor whose error is the effect, together with a channel.
    rod_friction: friction law of the rod that is the effect.
    switch: how a hypothesis changes to that law.
    delays: whether the engine delays the first input by the effect's first parameter.
    candidates: returns its candidates; by default its first parameter, or its symbols, from their nominal values.
    equivalent_effects: (estimates, plant's parameters, largest speed of the rod [m/s]) -> effects that no log can
        distinguish from this one, with the reason.
    replay: how a diagnosis simulates it along a measured signal.
    drifts: whether its numbers may differ from log to log of one rig, as an offset does.
    caveat: sentence that a diagnosis with this effect adds about its gaps.
    law: the expression of an effect from a TOML file.
    extends: another effect, to whose law this one adds a term with states of its own. The other one's candidates have
        its parameters, and a diagnosis reports them there. It acts beside the other effect alone if that has equations.
        It acts after all effects that extend none.
    source: of its equation.

    Raises TypeError for an unknown place.
    """

    name: str
    place: str
    summary: str
    fingerprint: str
    changes: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    parameters: tuple[EffectParameter, ...] = field(default=())
    states: tuple[EffectState, ...] = ()
    adds: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    symbols: Mapping[str, float] = field(default_factory=dict)
    groups: tuple[tuple[str, ...], ...] = ()
    wear_scales: Mapping[str, float] = field(default_factory=dict)
    related_symbols: tuple[str, ...] = ()
    from_balances: bool = False
    sensor: str | None = None
    rod_friction: str | None = None
    switch: LawSwitch | None = None
    delays: bool = False
    candidates: Callable[[Effect, DiagnosisContext], list[CandidateEffect]] | None = None
    equivalent_effects: Callable[[Mapping[str, float], Mapping[str, float], float], Mapping[str, str]] | None = None
    replay: MeasuredReplay | None = None
    drifts: bool = False
    caveat: str = ""
    law: EffectExpression | None = None
    extends: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if self.place not in PLACES:
            raise TypeError(f"effect {self.name}: place {self.place!r} is not one of {', '.join(PLACES)}")

    @property
    def wired(self) -> bool:
        """Whether it adds equations; the others are plant parameters, sensor settings or a friction law."""
        return bool(self.changes) or self.delays

    def parameter(self, name: str) -> EffectParameter:
        """One of its parameters by name."""
        return next(p for p in self.parameters if p.name == name)

    def free_in(self, context: DiagnosisContext) -> list[CandidateEffect]:
        """Its candidates for a diagnosis; empty if the log can't show it."""
        if self.extends:
            return []
        acts = self.delays or any(context.simulated(p.name) for p in self.parameters)
        if self.wired and not self.symbols and not acts:
            return []
        return (self.candidates or (from_symbols if self.symbols else from_neutral))(self, context)
