"""The parts of a system: states, inputs, contacts with friction, balances, and equations wired by name.

An equation is a pair (signal, function): the function's argument names say which states, inputs, parameters and
other signals it needs. The order of evaluation follows from these names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

ScalarFunction = Callable[..., float]


@dataclass(frozen=True)
class State:
    """A state variable; `scale` is the size of a relevant change, by which the engine scales integration errors."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class ParameterKind:
    """A parameter of a system without its value: unit, meaning and physical range.

    prior: relative standard deviation of a typical nominal value; None for one that is not refitted beside an effect.
    """

    name: str
    unit: str
    meaning: str
    lower: float = -1e30
    upper: float = 1e30
    lower_open: bool = False
    prior: float | None = None


@dataclass(frozen=True)
class Contact:
    """A friction contact, which slides or sticks.

    Attributes
    ----------
    name: "shaft" or "rod"; a plant's TOML chooses its law with shaft_friction or rod_friction.
    velocity: state that is the sliding speed (an input where the motion is prescribed).
    net: signal of the effort on the contact without friction (N m or N).
    friction: signal of the friction effort by the law of the plant's structure.
    direction: name of the sliding direction in the equations, +1 or -1.
    suffix: index of the friction symbols, e.g. FM in A_FM, B_FM.
    effort_unit, length_unit: N m and rad, or N and m.
    effort_scale: size of a relevant effort, by which the engine scales the search for a breakaway.
    bristle: inner state of friction laws that have one.
    stribeck_speed: tau for a plant without static friction, whose file gives none.
    symbols: friction symbols with another name in this system, e.g. {"A": "Fc"}.
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
        """Name of a friction symbol at this contact: A_FM for A."""
        return self.symbols.get(symbol, f"{symbol}_{self.suffix}")


@dataclass(frozen=True)
class Balance:
    """A sum that is zero in the true plant: parameters are estimated from it without a simulation, and its residual
    shows the unknown input behind a gap.

    Residual functions are wired by name like all equations. Besides states, inputs, signals and parameters they may
    use measurements: `omega_rate` is the measured rate of the state omega, `force_measured` the channel force of the
    log. A residual must be linear in the parameters that are estimated, except tau and beta.

    Attributes
    ----------
    name: for tables; the part before a comma names the unknown input of the residual: torque, flow, force or load.
    unit: of the residual.
    residuals: functions; those of one balance share parameters and are solved together.
    terms: for each residual a signal, input or measured channel as the reference for its size.
    contacts: contacts whose friction is a term; samples where one of them sticks are left out.
    without: channel whose presence makes this balance superfluous.
    closed: for each residual a signal that must be zero for it to be used, such as the unmeasured flow of a valve.
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
    """A system: everything except friction laws, chamber form, effects and numbers.

    Attributes
    ----------
    inputs: the drive and the external input.
    drives: input -> channel of the log that drives it in a replay.
    outputs: channel of the log -> state that it measures; simulations are compared with these.
    hold: of the drives between the samples of a log, "zero_order" or "first_order".
    chamber_forms: name in a plant's TOML -> equations of the chamber volumes; empty for a system without chambers.
    start: state -> parameter with its value at rest; the other states are zero at rest.
    cell: signal of a load cell; None without one.
    prescribed: contacts whose motion is an input; their friction occurs only in balances.
    balances: in the order of solution; a parameter estimated in one is known in the next.
    measured: further channels that the balances use.
    lacking: effects that a model of this system without dry friction lacks; sets of ids, each searched from the
        solution of the one before.
    called: symbols of the EHSA in the catalogue of effects -> names in this system, except those of friction.
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
        """Name in this system of a symbol in the catalogue of effects: A_FR may be Fc."""
        for contact in self.all_contacts:
            for family, name in contact.symbols.items():
                if symbol == f"{family}_{contact.suffix}":
                    return name
        return self.called.get(symbol, symbol)

    @property
    def drive(self) -> str:
        """Channel of the log that drives the first input."""
        return self.drives[self.inputs[0]]

    @property
    def all_contacts(self) -> tuple[Contact, ...]:
        """Contacts that the simulation solves, then those with prescribed motion."""
        return (*self.contacts, *self.prescribed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel of a log that this system uses."""
        return tuple(dict.fromkeys([*self.drives.values(), *self.outputs, *self.measured]))
