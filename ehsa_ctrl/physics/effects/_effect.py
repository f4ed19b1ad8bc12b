"""The definition of an effect: something a real rig does that (12) does not, switched on by name.

An effect's file holds everything that is known of it: equations, parameters, its signature in a log, how a diagnosis
sets it free, and which other effects no log can tell from it.

An effect changes signals of the plant, one function a signal. The function takes the signal's former value by its
name, and whatever else it needs by name: states, inputs, parameters, other signals. At its neutral parameters it
returns the former value unchanged, to the last bit. An effect may add states, whose rates are zero while it is neutral.
Some effects have no equation: a wrong parameter of the plant, a sensor's setting, or another friction law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf

import numpy as np

from ...core.log import Log
from ._candidate import CandidateEffect, DiagnosisContext, from_neutral, from_symbols

PLACES = ("torque", "drive", "flow", "force", "sensor")


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit, meaning: as in the tables.
    neutral: the value at which the effect is absent (may be infinite).
    typical: the value taken when a plant switches the effect on and gives none.
    lower, upper: physical bounds.
    source: where `typical` comes from.
    felt: size of a change that a log shows; a tenth of the way from neutral to typical by default.
    search: bounds of a diagnosis' search where they are narrower than the physical ones.
    shape: a location or shape, which means nothing while the first parameter is neutral.
    """

    name: str
    unit: str
    meaning: str
    neutral: float
    typical: float
    lower: float
    upper: float = inf
    source: str = "assumed"
    felt: float | None = None
    search: tuple[float, float] | None = None
    shape: bool = False

    @property
    def scale(self) -> float:
        """Size of a change that a log shows."""
        return self.felt if self.felt is not None else 0.1 * abs(self.typical - self.neutral)


@dataclass(frozen=True)
class EffectState:
    """A state that an effect adds; `scale` as in a system's states. Its rate is the effect's signal NAME_dot.

    A run that starts in motion starts this state at zero, or at the value of the input `starts_at`, or at the value
    that `along` (log -> (N,)) gives for the sample.
    """

    name: str
    unit: str
    scale: float
    starts_at: str | None = None
    along: Callable[[Log], np.ndarray] | None = None


@dataclass(frozen=True)
class MeasuredReplay:
    """Lets a simulation apply an effect along a measured signal instead of the simulated one.

    channel: what `prepare` adds to a log.
    prepare: plant's parameters, log, reference log or None -> the log with the channel, in phase with the reference.
    drive: parameters, log with the channel -> (N,) what the effect adds to the first input.
    """

    channel: str
    prepare: Callable[[Mapping[str, float], Log, Log | None], Log]
    drive: Callable[[Mapping[str, float], Log], np.ndarray]


@dataclass(frozen=True)
class LawSwitch:
    """Lets a hypothesis replace the friction law of the rod.

    law: the other law. number: a hypothesis' free number, the reciprocal of the law's `parameter`, so that zero is the
    plant without the effect; the law is used while it exceeds `threshold`. reported: the parameter's name in results.
    defaults: further parameters of the law -> value from that number and the plant's parameters.
    state: the law's state; deflection: its value per unit of compliance where a run starts in motion; the arguments are
    states and parameters by name.
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
    """One effect: where it acts, what it changes and how a log shows it. Compared by identity: two projects may have
    different effects of one name.

    Attributes
    ----------
    name: its id in plants, lists and diagnoses.
    place: the balance it disturbs, one of PLACES.
    summary: one line for lists.
    fingerprint: its signature in a log.
    changes: signal name -> function that gives the signal's new value.
    parameters: in the order of importance; the first one measures the size.
    states: that it adds; adds: their rates, signal name -> function, which may ask for `asked_current`, the current
        before any effect.
    symbols: parameters of the plant that are the effect when their value is wrong, each with the size of a change that
        a log shows where the nominal value is zero. groups: those that become free together, if not all at once.
    wears: parameters that change by orders of magnitude, each with the size of a change.
    also: further plant parameters that are reported under this effect.
    from_balances: a plant that has none of it is searched from the level that its balances show.
    sensor: a sensor's setting that is the effect, together with a channel.
    rod_friction: the friction law of the rod that is the effect; switch: how a hypothesis changes to it.
    delays: the engine delays the first input by the effect's first parameter.
    candidates: how it becomes free in a diagnosis, if not from neutral to a size that a log shows.
    equivalent_effects: values found, the plant's, largest speed of the rod [m/s] -> effects that no log can
        tell from this one, each with the reason.
    replay: how a diagnosis simulates it along a measured signal.
    caveat: what a diagnosis that names it has to add about its gaps.
    source: of its equation.
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
    wears: Mapping[str, float] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    from_balances: bool = False
    sensor: str | None = None
    rod_friction: str | None = None
    switch: LawSwitch | None = None
    delays: bool = False
    candidates: Callable[[Effect, DiagnosisContext], list[CandidateEffect]] | None = None
    equivalent_effects: Callable[[Mapping[str, float], Mapping[str, float], float], Mapping[str, str]] | None = None
    replay: MeasuredReplay | None = None
    caveat: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if self.place not in PLACES:
            raise TypeError(f"effect {self.name}: place {self.place!r} is none of {', '.join(PLACES)}")

    @property
    def wired(self) -> bool:
        """Whether it adds equations; the others are plant parameters, sensor settings or a friction law."""
        return bool(self.changes) or self.delays

    def parameter(self, name: str) -> EffectParameter:
        """One of its parameters by name."""
        return next(p for p in self.parameters if p.name == name)

    def free_in(self, context: DiagnosisContext) -> list[CandidateEffect]:
        """The ways to set it free in a diagnosis; none where the log could not show it."""
        acts = self.delays or any(context.simulated(p.name) for p in self.parameters)
        if self.wired and not self.symbols and not acts:
            return []
        return (self.candidates or (from_symbols if self.symbols else from_neutral))(self, context)
