"""What an effect is: something a real rig does that (12) does not, switched on by name.

An effect changes signals of the plant, one function a signal. The function takes the signal's former value by its
name, and whatever else it needs by name: states, inputs, parameters, other signals. At its neutral parameters it
returns the former value unchanged, to the last bit. An effect may bring states of its own, whose rates are zero while
it is neutral. Some effects are there already, as a letter of the plant whose value is wrong, a sensor's setting or
another friction law; they name it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf

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
    """

    name: str
    unit: str
    meaning: str
    neutral: float
    typical: float
    lower: float
    upper: float = inf
    source: str = "assumed"


@dataclass(frozen=True)
class EffectState:
    """A state that an effect adds; `scale` as in a system's states. Its rate is the effect's signal NAME_dot."""

    name: str
    unit: str
    scale: float


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
    letters: letters of the plant that are the effect when their value is wrong.
    sensor: the word of a sensor's setting that is the effect, with a channel.
    rod_friction: the friction law of the rod that is the effect.
    delays: the first input acts later, by the effect's first parameter; the engine does it.
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
    letters: tuple[str, ...] = ()
    sensor: str | None = None
    rod_friction: str | None = None
    delays: bool = False
    source: str = ""

    def __post_init__(self) -> None:
        if self.place not in PLACES:
            raise TypeError(f"effect {self.name}: place {self.place!r} is none of {', '.join(PLACES)}")

    @property
    def wired(self) -> bool:
        """Whether it adds equations; the others are letters, sensor settings or a friction law."""
        return bool(self.changes) or self.delays
