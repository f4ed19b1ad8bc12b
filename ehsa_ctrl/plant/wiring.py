"""Wiring: connect the functions of a structure by their argument names and order them for evaluation."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

from ..core.errors import InputError, choices
from ..core.syntax import argument_names
from ..physics.effects import EFFECTS
from ..physics.friction import held
from .system import Balance, ParameterKind, ScalarFunction, State

if TYPE_CHECKING:
    from .structure import Structure


#: Prefix of a signal's name: its value before any effect.
ASKED = "asked_"


@dataclass(frozen=True)
class Call:
    """One equation: target = function(**arguments); arguments are names of states, inputs, parameters or targets."""

    target: str
    function: ScalarFunction
    arguments: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of one structure in an order of evaluation. Compared by identity, so that caches may use them.

    Attributes
    ----------
    states: states of the system, then inner states of friction laws and effects.
    rates: one signal per state: its time derivative.
    inputs: the drive and the external input; for the EHSA current and external force.
    directions: sliding direction of each contact, set by the contact's mode.
    parameters: in a fixed order.
    calls: the equations; every argument is a state, input, direction, parameter or an earlier target.
    signals: signal -> target with its value after all effects, e.g. signals["Q_1"] == "Q_1__relief_valve".
    residuals: for each balance of the system, the targets of its residuals among `residual_calls`.
    residual_calls: further equations of the balances, which a simulation does not need.
    measured: names that occur only in residual calls: STATE_rate, CHANNEL_measured, directions of prescribed motion.
    """

    structure: Structure
    states: tuple[State, ...]
    rates: tuple[str, ...]
    inputs: tuple[str, ...]
    directions: tuple[str, ...]
    parameters: tuple[ParameterKind, ...]
    calls: tuple[Call, ...]
    signals: Mapping[str, str]
    residuals: tuple[tuple[str, ...], ...]
    residual_calls: tuple[Call, ...]
    measured: tuple[str, ...]

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    def index(self, state: str) -> int:
        """Position of a state in the state vector. Raises InputError for a state that the system does not have."""
        names = [s.name for s in self.states]
        if state not in names:
            raise InputError(
                f"{state!r} is not a state of the system {self.structure.system_name!r}; {choices(state, names)}"
            )
        return names.index(state)


class _Wiring:
    """Orders the equations, starting from the wanted signals: each call follows those that it needs."""

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        system = structure.system
        self.sources: dict[str, tuple[ScalarFunction, dict[str, str]]] = {}
        self.states: list[State] = list(system.states)
        kinds = {kind.name: kind for kind in system.parameters}
        chambers = () if structure.chambers is None else system.chamber_forms[structure.chambers]
        for signal, function in (*system.equations, *chambers):
            self.sources[signal] = (function, {})
        for contact in system.all_contacts:
            law = structure.law(contact)
            names = {symbol: contact.symbol(symbol) for symbol in law.symbols}
            names |= {"direction": contact.direction, "speed": contact.velocity}
            names |= {"z": contact.bristle.name, "z_dot": f"{contact.bristle.name}_dot"}
            self.sources[contact.friction] = (law.effort, names)
            if law.state_rate is not None:
                self.states.append(contact.bristle)
                self.sources[f"{contact.bristle.name}_dot"] = (law.state_rate, names)
            for symbol, part in law.symbols.items():
                kinds[contact.symbol(symbol)] = ParameterKind(
                    contact.symbol(symbol),
                    part.unit_at(contact.effort_unit, contact.length_unit),
                    f"{part.meaning}, {contact.name}",
                    part.lower,
                    part.upper,
                    lower_open=part.lower_open,
                    prior=part.prior,
                )
        self.changes: dict[str, list[tuple[str, ScalarFunction]]] = {}
        for name in structure.effects:
            self.states += [State(state.name, state.unit, state.scale) for state in EFFECTS[name].states]
            for signal, function in EFFECTS[name].adds.items():
                self.sources[signal] = (function, {})
        self.held = {f"{c.velocity}_dot": c.direction for c in system.contacts if structure.law(c).sticks}
        for name in structure.effects:
            for signal, function in system.own_changes(EFFECTS[name].changes).items():
                self.changes.setdefault(signal, []).append((name, function))
            for parameter in EFFECTS[name].parameters:
                lower, upper = parameter.lower, parameter.upper
                if math.isfinite(parameter.neutral):
                    # Infinity is allowed only where it is the neutral value, as for a valve that never opens.
                    lower, upper = max(lower, ParameterKind.lower), min(upper, ParameterKind.upper)
                kinds[parameter.name] = ParameterKind(parameter.name, parameter.unit, parameter.meaning, lower, upper)
        self.kinds = kinds
        self.given = {s.name for s in self.states} | set(system.inputs) | {c.direction for c in system.contacts}
        self.measured = (
            *(f"{name}_rate" for name in [*(s.name for s in system.states), *system.inputs]),
            *(f"{channel}_measured" for channel in system.channels),
            *(contact.direction for contact in system.prescribed),
        )
        self.calls: list[Call] = []
        self.placed: dict[str, str] = {}
        self.open: list[str] = []
        self.used: set[str] = set()

    def place(self, name: str, asked_by: str = "") -> str:
        """Append the calls that signal `name` needs; returns the target with its final value.

        asked_by: function that needs it, for the message. Raises InputError for an unknown name and for a loop.
        """
        name = self.structure.system.own(name)
        if name in self.placed:
            return self.placed[name]
        # asked_current is the current before any effect: the state of an effect may follow it, while the effect changes
        # the current that acts.
        if name.startswith(ASKED):
            self.place(name.removeprefix(ASKED), asked_by)
            return self.placed[name]
        if name in self.open:
            raise InputError(f"algebraic loop: {' -> '.join([*self.open, name])}; break it with a state")
        self.open.append(name)
        if name in self.sources:
            function, names = self.sources[name]
            current = self._call(name, function, names)
        elif name in self.given:
            current = name
        elif name in self.kinds:
            self.used.add(name)
            current = name
        else:
            known = {*self.sources, *self.given, *self.kinds}
            raise InputError(
                f"{asked_by or 'an equation'} needs {name!r}, which is not a signal, state, input or parameter of the "
                f"system {self.structure.system.name!r} with these friction laws and effects; {choices(name, known)}"
            )
        self.placed[f"{ASKED}{name}"] = current
        # What extends a law shares out what all other effects leave of it.
        changes = sorted(self.changes.get(name, ()), key=lambda change: bool(EFFECTS[change[0]].extends))
        for effect, function in changes:
            old = {a for a in argument_names(function) if self.structure.system.own(a) == name}
            current = self._call(f"{name}__{effect}", function, dict.fromkeys(old, current), ready=old)
        if name in self.held:
            names = {"rate": current, "direction": self.held[name]}
            current = self._call(f"{name}__held", held, names, ready={"rate", "direction"})
        self.open.pop()
        self.placed[name] = current
        return current

    def residuals(self, balance: Balance) -> tuple[str, ...]:
        """Append the residuals of a balance, which may use measured names; returns their targets."""
        self.given |= set(self.measured)
        names = [f"{balance.name}__{function.__name__}" for function in balance.residuals]
        for term in (*balance.terms, *balance.closed):
            self.place(term)
        for name, function in zip(names, balance.residuals, strict=True):
            self._call(name, function, {})
        return tuple(names)

    def _call(
        self, target: str, function: ScalarFunction, names: Mapping[str, str], ready: set[str] | None = None
    ) -> str:
        arguments = {}
        asked_by = f"{inspect.getsourcefile(function)}, function {function.__name__},"
        for argument in argument_names(function):
            source = names.get(argument, argument)
            arguments[argument] = source if ready and argument in ready else self.place(source, asked_by)
        self.calls.append(Call(target, function, arguments))
        return target


@cache
def wire(structure: Structure, parts: tuple[object, ...]) -> Equations:
    """The equations of a structure, ordered for evaluation, with the residuals of its balances.

    parts: what the structure's names stand for (`Structure.parts`), so that a file that has changed is wired again.
    """
    wiring = _Wiring(structure)
    system = structure.system
    rates = tuple(wiring.place(f"{state.name}_dot") for state in wiring.states)
    for signal, _ in system.equations:
        wiring.place(signal)
    calls, signals = tuple(wiring.calls), dict(wiring.placed)
    residuals = tuple(wiring.residuals(balance) for balance in system.balances)
    for contact in system.contacts:
        law = structure.law(contact)
        if law.band is not None:
            wiring.used.add(contact.symbol(law.band))
    wiring.used |= set(system.start.values())
    for name in structure.effects:
        wiring.used |= {parameter.name for parameter in EFFECTS[name].parameters}
    return Equations(
        structure=structure,
        states=tuple(wiring.states),
        rates=rates,
        inputs=system.inputs,
        directions=tuple(contact.direction for contact in system.contacts),
        parameters=tuple(kind for kind in wiring.kinds.values() if kind.name in wiring.used),
        calls=calls,
        signals=signals,
        residuals=residuals,
        residual_calls=tuple(wiring.calls[len(calls) :]),
        measured=tuple(name for name in wiring.measured if name in wiring.placed),
    )
