"""The friction law interface: one scalar function, and the properties that engine and tests need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

from ...core.syntax import argument_names


@dataclass(frozen=True)
class FrictionParameter:
    """A parameter of friction laws.

    Attributes
    ----------
    symbol: argument of a law's functions; A becomes A_FM on the shaft and A_FR on the rod.
    unit: SI, in terms of the contact's {effort} (N or N m) and {length} (m or rad): "{effort} s/{length}".
    meaning: one line for tables and messages.
    lower, upper: physical range, in the contact's units; lower_open: `lower` itself is not allowed.
    prior: relative standard deviation of a typical nominal value (engineering judgement); None for a parameter that a
        diagnosis does not refit.
    absent: value that switches off the parameter's part of the friction; None if there is no such value.
    """

    symbol: str
    unit: str
    meaning: str
    lower: float = 0.0
    upper: float = 1e30
    lower_open: bool = False
    prior: float | None = None
    absent: float | None = None

    def __post_init__(self) -> None:
        if not self.symbol.isidentifier() or self.symbol in ARGUMENTS:
            raise TypeError(
                f"friction parameter {self.symbol!r}: expected a Python name other than {', '.join(ARGUMENTS)}"
            )
        if not self.lower < self.upper:
            raise TypeError(
                f"friction parameter {self.symbol}: lower = {self.lower:g}, upper = {self.upper:g}; "
                "expected lower < upper"
            )

    def unit_at(self, effort: str, length: str) -> str:
        """Unit at a contact, from the units of its effort and displacement."""
        return self.unit.format(effort=effort, length=length)


#: Quantities of the contact that a law may use.
ARGUMENTS = ("direction", "speed", "z", "z_dot")

#: Symbol -> parameter that every law may use without declaring it. Engineering judgement: at 1e8 N/m, bristles hardly
#: yield.
SYMBOLS = {
    parameter.symbol: parameter
    for parameter in (
        FrictionParameter("A", "{effort}", "Coulomb level", prior=0.1, absent=0.0),
        FrictionParameter("B", "{effort} s/{length}", "viscous coefficient", prior=0.1, absent=0.0),
        FrictionParameter("C", "{effort}", "static minus Coulomb level", prior=0.15, absent=0.0),
        FrictionParameter(
            "tau", "{length}/s", "speed at which the static part has decayed", lower_open=True, prior=0.15
        ),
        FrictionParameter("v_band", "{length}/s", "half width of the dead band"),
        FrictionParameter("sigma_0", "{effort}/{length}", "bristle stiffness", lower_open=True, absent=1e8),
        FrictionParameter("sigma_1", "{effort} s/{length}", "bristle damping", absent=0.0),
    )
}


@dataclass(frozen=True)
class FrictionLaw:
    """A friction law.

    Attributes
    ----------
    name: word used in a plant's TOML.
    summary: one line for lists.
    effort: friction during sliding, `effort(direction, speed, ...)` with direction +1 or -1, or, for a law with an
        inner state, `effort(speed, z, z_dot, ...)`. It opposes the motion: positive for positive speed.
    sticks: whether the law is set-valued at rest. Its breakaway effort is `effort` at speed 0 in the direction of the
        net effort.
    band: parameter with the speed below which the contact sticks (Karnopp); None if it sticks at exactly 0.
    state_rate: d z/dt of the inner state, None for a law without one.
    passive: whether effort * speed >= 0 always; the docstring of a law that is not passive gives the reason.
    parameters: own parameters of the law, those not in SYMBOLS.

    Raises TypeError for an argument that is not a parameter, and for a parameter that is unused or in SYMBOLS.
    """

    name: str
    summary: str
    effort: Callable[..., float]
    sticks: bool
    band: str | None = None
    state_rate: Callable[..., float] | None = None
    passive: bool = True
    parameters: tuple[FrictionParameter, ...] = ()

    def __post_init__(self) -> None:
        own = [parameter.symbol for parameter in self.parameters]
        if unknown := sorted(self._asked - {*SYMBOLS, *ARGUMENTS, *own}):
            raise TypeError(
                f"friction law {self.name}: {unknown[0]!r} is neither an argument of the contact "
                f"({', '.join(ARGUMENTS)}) nor a parameter ({', '.join([*SYMBOLS, *own])}); declare it in `parameters`"
            )
        for symbol in own:
            if symbol in SYMBOLS or own.count(symbol) > 1:
                raise TypeError(f"friction law {self.name}: the parameter {symbol!r} is declared already; rename it")
            if symbol not in self._asked and symbol != self.band:
                raise TypeError(f"friction law {self.name}: no function uses the parameter {symbol!r}; leave it out")

    @cached_property
    def _asked(self) -> set[str]:
        """Arguments of its functions."""
        functions = (self.effort,) if self.state_rate is None else (self.effort, self.state_rate)
        return {argument for function in functions for argument in argument_names(function)}

    @cached_property
    def symbols(self) -> dict[str, FrictionParameter]:
        """The parameters that the law needs, by symbol: those of SYMBOLS in their order, then its own."""
        used = self._asked if self.band is None else self._asked | {self.band}
        known = SYMBOLS | {parameter.symbol: parameter for parameter in self.parameters}
        return {symbol: parameter for symbol, parameter in known.items() if symbol in used}

    def steady_state(self, speed: float, parameters: Mapping[str, float]) -> float:
        """Inner state at a constant speed, by the law's parameters; `state_rate` must be linear in the state."""
        assert self.state_rate is not None
        if speed == 0.0:
            return 0.0
        code = self.state_rate.__code__
        values = {name: parameters[name] for name in code.co_varnames[: code.co_argcount] if name in parameters}
        # The rate is linear in z, so two values give its zero.
        at_zero, at_one = (self.state_rate(speed=speed, z=z, **values) for z in (0.0, 1.0))
        return at_zero / (at_zero - at_one)


def held(rate: float, direction: float) -> float:
    """Acceleration of a contact that can stick; zero while it sticks (direction 0)."""
    return rate if direction != 0.0 else 0.0
