"""What a system is made of: states, inputs, contacts with friction, and equations wired by name.

An equation is a pair (signal, function): the function's argument names say which states, inputs, parameters and
other signals it needs. That is the whole wiring; an order of evaluation follows from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

ScalarFunction = Callable[..., float]


@dataclass(frozen=True)
class State:
    """A state variable; `scale` is the size of a change that matters, the unit in which the engine weighs errors."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class ParameterKind:
    """What a parameter of a system is, apart from its value: unit, meaning and hard physical range."""

    name: str
    unit: str
    meaning: str
    lower: float = -1e30
    upper: float = 1e30
    lower_open: bool = False


@dataclass(frozen=True)
class Contact:
    """A place where something slides or sticks.

    Attributes
    ----------
    name: "shaft" or "rod".
    velocity: state that is the sliding speed.
    net: signal, what drives the contact apart from friction (N m or N).
    friction: signal, the friction that the law of the plant's structure gives.
    direction: name of the sliding direction in the equations, +1 or -1.
    suffix: the paper's index of the friction letters, e.g. FM: A_FM, B_FM ...
    effort_unit, length_unit: N m and rad, or N and m.
    effort_scale: size of an effort that matters, the unit in which the engine finds a breakaway.
    bristle: name and size of the inner state of a law that has one.
    """

    name: str
    velocity: str
    net: str
    friction: str
    direction: str
    suffix: str
    effort_unit: str
    length_unit: str
    effort_scale: float
    bristle: State

    def letter(self, letter: str) -> str:
        """A of the family is A_FM here."""
        return f"{letter}_{self.suffix}"


@dataclass(frozen=True)
class System:
    """States, inputs, contacts, equations: everything but friction laws, chamber form, effects and numbers."""

    name: str
    states: tuple[State, ...]
    inputs: tuple[str, ...]
    contacts: tuple[Contact, ...]
    equations: tuple[tuple[str, ScalarFunction], ...]
    parameters: tuple[ParameterKind, ...]
