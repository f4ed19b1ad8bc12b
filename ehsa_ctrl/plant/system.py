"""What a system is made of: states, inputs, contacts with friction, and equations wired by name.

An equation is a pair (signal, function): the function's argument names say which states, inputs, parameters and
other signals it needs. That is the whole wiring; an order of evaluation follows from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

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
    name: "shaft" or "rod"; a plant's TOML chooses its law with shaft_friction or rod_friction.
    velocity: state that is the sliding speed (an input where the motion is prescribed).
    net: signal, what drives the contact apart from friction (N m or N).
    friction: signal, the friction that the law of the plant's structure gives.
    direction: name of the sliding direction in the equations, +1 or -1.
    suffix: the paper's index of the friction symbols, e.g. FM: A_FM, B_FM ...
    effort_unit, length_unit: N m and rad, or N and m.
    effort_scale: size of an effort that matters, the unit in which the engine finds a breakaway.
    bristle: name and size of the inner state of a law that has one.
    stribeck_speed: tau of the friction family where a plant without static friction gives none.
    symbols: symbols of the family that have a name of their own here, e.g. {"A": "Fc"}.
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
    symbols: Mapping[str, str] = field(default_factory=dict)
    stribeck_speed: float = 0.01

    def symbol(self, symbol: str) -> str:
        """A of the family is A_FM here."""
        return self.symbols.get(symbol, f"{symbol}_{self.suffix}")


@dataclass(frozen=True)
class Balance:
    """A sum that is zero in the true plant: what parameters are estimated from without a simulation.

    Residual functions are wired by name like all equations. Beside states, inputs, signals and parameters they may
    ask for measured things: `omega_rate` is the measured rate of the state omega, `force_measured` the log's channel
    force. A residual must be linear in the parameters that are to be estimated, tau and beta apart.

    Attributes
    ----------
    name: for tables.
    unit: of the residual.
    residuals: functions; those of one balance are solved together because they share parameters.
    terms: one signal, input or measured channel for each residual, against which its size is judged.
    contacts: names of contacts whose friction stands in it; samples where one of these sticks are left out.
    without: channel whose presence makes this balance superfluous.
    closed: for each residual a signal that must be zero for it to be used: a valve's flow, which nothing measures.
    """

    name: str
    unit: str
    residuals: tuple[ScalarFunction, ...]
    terms: tuple[str, ...]
    contacts: tuple[str, ...] = ()
    without: str | None = None
    closed: tuple[str, ...] = ()


@dataclass(frozen=True)
class System:
    """States, inputs, contacts, equations: everything but friction laws, chamber form, effects and numbers.

    Attributes
    ----------
    inputs: two of them: what drives the system and what acts on it from outside.
    drives: input -> the log's channel that drives it in a replay of a log.
    outputs: the log's channel -> the state it measures; what a simulation is held against.
    hold: how the drives act between the samples of a log: "zero_order" or "first_order".
    chamber_forms: word in a plant's TOML -> equations of the chamber volumes; empty for a system without chambers.
    start: state -> parameter that is its value at rest; the other states are zero there.
    cell: signal that a load cell reads; None where the equations have none.
    prescribed: contacts whose motion is an input; their friction stands in balances alone.
    balances: in the order in which they are solved; a parameter found in one is known in the next.
    measured: channels beside drives and outputs that balances use.
    lacking: ids of the effects that a model of this system without dry friction lacks; sets, each searched from where
        the one before came to.
    called: symbols of the EHSA that the catalogue of effects uses -> what they are called here, friction's apart.
    """

    name: str
    states: tuple[State, ...]
    inputs: tuple[str, ...]
    drives: Mapping[str, str]
    outputs: Mapping[str, str]
    contacts: tuple[Contact, ...]
    equations: tuple[tuple[str, ScalarFunction], ...]
    parameters: tuple[ParameterKind, ...]
    hold: Literal["zero_order", "first_order"] = "zero_order"
    title: str = ""
    chamber_forms: Mapping[str, tuple[tuple[str, ScalarFunction], ...]] = field(default_factory=dict)
    start: Mapping[str, str] = field(default_factory=dict)
    cell: str | None = None
    prescribed: tuple[Contact, ...] = ()
    balances: tuple[Balance, ...] = ()
    measured: tuple[str, ...] = ()
    lacking: tuple[tuple[str, ...], ...] = ()
    called: Mapping[str, str] = field(default_factory=dict)

    def own(self, symbol: str) -> str:
        """What a symbol of the catalogue is called here: A_FR may be Fc."""
        for contact in self.all_contacts:
            for family, name in contact.symbols.items():
                if symbol == f"{family}_{contact.suffix}":
                    return name
        return self.called.get(symbol, symbol)

    @property
    def drive(self) -> str:
        """The log's channel that drives the first input."""
        return self.drives[self.inputs[0]]

    @property
    def all_contacts(self) -> tuple[Contact, ...]:
        """Contacts that the simulation solves for, then those whose motion is prescribed."""
        return (*self.contacts, *self.prescribed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel of a log that means something to this system."""
        return tuple(dict.fromkeys([*self.drives.values(), *self.outputs, *self.measured]))
