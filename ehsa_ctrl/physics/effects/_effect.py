"""What an effect is: something a real rig does that (12) does not, switched on by name.

An effect changes signals of the plant, one function a signal. The function takes the signal's former value by its
name, and whatever else it needs by name: states, inputs, parameters, other signals. At its neutral parameters it
returns the former value unchanged, to the last bit.
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
    """

    name: str
    place: str
    summary: str
    fingerprint: str
    changes: Mapping[str, Callable[..., float]]
    parameters: tuple[EffectParameter, ...] = field(default=())

    def __post_init__(self) -> None:
        if self.place not in PLACES:
            raise TypeError(f"effect {self.name}: place {self.place!r} is none of {', '.join(PLACES)}")
