"""What a friction law is: one scalar function, and the facts that the engine and the tests need to know of it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass

#: Symbols a law may use for its parameters, with the unit in terms of the contact's effort (N or N m) and of its
#: displacement (m or rad). On the shaft A becomes A_FM, on the rod A_FR.
SYMBOLS = {
    "A": ("{effort}", "Coulomb level"),
    "B": ("{effort} s/{length}", "viscous coefficient"),
    "C": ("{effort}", "static minus Coulomb level"),
    "tau": ("{length}/s", "speed at which the static part has decayed"),
    "v_band": ("{length}/s", "half width of the dead band"),
    "sigma_0": ("{effort}/{length}", "bristle stiffness"),
    "sigma_1": ("{effort} s/{length}", "bristle damping"),
}

#: What a law may ask of its contact.
ARGUMENTS = ("direction", "speed", "z", "z_dot")

#: What these are in a contact without the law's part: no friction, bristles too stiff to yield.
ABSENT = {"A": 0.0, "B": 0.0, "C": 0.0, "sigma_0": 1e8, "sigma_1": 0.0}
#: Relative standard deviations of typical nominal values.
PRIOR = {"A": 0.1, "B": 0.1, "C": 0.15, "tau": 0.15}


@dataclass(frozen=True)
class FrictionLaw:
    """One member of the friction family.

    Attributes
    ----------
    name: word used in a plant's TOML.
    summary: one line for lists.
    effort: friction while sliding, `effort(direction, speed, ...)` with direction +1 or -1, or, for a law with an
        inner state, `effort(speed, z, z_dot, ...)`. It opposes the motion: positive for positive speed.
    sticks: the law is set-valued at rest. What it can hold is its value at speed 0 in the direction of the net effort.
    band: name of the parameter that is the speed below which the contact is captured (Karnopp); None: exactly 0.
    state_rate: d z/dt of the inner state, None for a law without one.
    passive: effort * speed >= 0 always; False needs the reason in the law's docstring.
    """

    name: str
    summary: str
    effort: Callable[..., float]
    sticks: bool
    band: str | None = None
    state_rate: Callable[..., float] | None = None
    passive: bool = True

    def __post_init__(self) -> None:
        if unknown := sorted(self._asked - {*SYMBOLS, *ARGUMENTS}):
            raise TypeError(
                f"friction law {self.name}: {unknown[0]!r} is neither an argument of the contact "
                f"({', '.join(ARGUMENTS)}) nor a symbol for a parameter ({', '.join(SYMBOLS)})"
            )

    @property
    def _asked(self) -> set[str]:
        """Names of the arguments of its functions."""
        functions = (self.effort,) if self.state_rate is None else (self.effort, self.state_rate)
        return {argument for function in functions for argument in inspect.signature(function).parameters}

    @property
    def symbols(self) -> tuple[str, ...]:
        """The parameters the law needs, in the order of SYMBOLS."""
        used = self._asked if self.band is None else self._asked | {self.band}
        return tuple(symbol for symbol in SYMBOLS if symbol in used)


def held(rate: float, direction: float) -> float:
    """Acceleration of a contact that can stick: none while it does (direction 0)."""
    return rate if direction != 0.0 else 0.0
