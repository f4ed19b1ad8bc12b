"""What an effect is: something a real rig does that (12) does not, switched on by name.

An effect's file holds all that is known of it: equations, numbers, what gives it away in a log, how a diagnosis sets it
free, and what it can't be told from.

An effect changes signals of the plant, one function a signal. The function takes the signal's former value by its
name, and whatever else it needs by name: states, inputs, parameters, other signals. At its neutral parameters it
returns the former value unchanged, to the last bit. An effect may bring states of its own, whose rates are zero while
it is neutral. Some effects are there already, as a symbol of the plant whose value is wrong, a sensor's setting or
another friction law; they name it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf

from ._candidate import Candidate, Rig, from_neutral, from_symbols

PLACES = ("torque", "drive", "flow", "force", "sensor")


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Attributes
    ----------
    name, unit, meaning: as in the tables.
    neutral: the value at which the effect is not there (may be infinite).
    typical: the value taken when a plant switches the effect on and says nothing else.
    lower, upper: physical bounds.
    source: where `typical` comes from.
    felt: the size of a change that a log shows; a tenth of the way from neutral to typical by default.
    search: bounds of a diagnosis' search where they are narrower than the physical ones.
    shape: it says where or how the effect acts, and means nothing while the first number is neutral.
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
        """The size of a change that a log shows."""
        return self.felt if self.felt is not None else 0.1 * abs(self.typical - self.neutral)


@dataclass(frozen=True)
class EffectState:
    """A state that an effect adds; `scale` as in a system's states. Its rate is the effect's signal NAME_dot.

    starts_at: the input whose value it has where a run begins in motion; else it begins as a run from rest does.
    """

    name: str
    unit: str
    scale: float
    starts_at: str | None = None


@dataclass(frozen=True)
class Effect:
    """One effect: where it acts, what it changes and what gives it away.

    Attributes
    ----------
    name: its id in plants, lists and diagnoses.
    place: the balance it disturbs, one of PLACES.
    summary: one line for lists.
    fingerprint: what it looks like in a log.
    changes: signal name -> function that gives the signal's new value.
    parameters: in the order of importance; the first one measures the size.
    states: that it adds; adds: their rates, signal name -> function, which may ask for `asked_current`, the current
        before any effect.
    symbols: symbols of the plant that are the effect when their value is wrong, each with a size that is felt where
        the plant believes it to be zero. groups: those that become free together, if not all at once.
    wears: symbols that change by factors and not by per cents, each with the size of a change.
    also: further nominal parameters that are reported under this effect.
    from_balances: a plant that has none of it is searched from the level that its balances show.
    sensor: the word of a sensor's setting that is the effect, with a channel.
    rod_friction: the friction law of the rod that is the effect.
    delays: the first input acts later, by the effect's first parameter; the engine does it.
    candidates: how it becomes free in a diagnosis, if not from neutral to where it is felt.
    same: values found, the plant's, largest flow A v through the lines [m3/s] -> effects that no log whatever can tell
        from this one, and why.
    caveat: what has to be said of the gaps of a diagnosis that names it.
    source: where its equation comes from.
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
    delays: bool = False
    candidates: Callable[[Effect, Rig], list[Candidate]] | None = None
    same: Callable[[Mapping[str, float], Mapping[str, float], float], Mapping[str, str]] | None = None
    caveat: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if self.place not in PLACES:
            raise TypeError(f"effect {self.name}: place {self.place!r} is none of {', '.join(PLACES)}")

    @property
    def wired(self) -> bool:
        """Whether it adds equations; the others are symbols, sensor settings or a friction law."""
        return bool(self.changes) or self.delays

    def parameter(self, name: str) -> EffectParameter:
        """One of its numbers by name."""
        return next(p for p in self.parameters if p.name == name)

    def free_in(self, rig: Rig) -> list[Candidate]:
        """The ways to set it free in a diagnosis of this rig; none where the log could not show it."""
        if self.wired and not self.symbols and not (self.delays or any(rig.shows(p.name) for p in self.parameters)):
            return []
        return (self.candidates or (from_symbols if self.symbols else from_neutral))(self, rig)
