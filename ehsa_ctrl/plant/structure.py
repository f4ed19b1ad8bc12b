"""The structure of a plant: which friction law at each contact, which chamber form, which effects.

A structure is only words, hashable, so that engine texts can be cached by it. `equations()` turns it into the wired
list of equations that everything else works on: the plain evaluation, the compiled engine, the linearisation.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

from ..core.errors import InputError, choices
from ..physics.effects import EFFECTS, Effect
from ..physics.friction import LAWS, SYMBOLS, FrictionLaw, held
from .system import Balance, Contact, ParameterKind, ScalarFunction, State, System
from .systems import SYSTEMS


@dataclass(frozen=True)
class Structure:
    """Words that select the equations.

    Attributes
    ----------
    shaft_friction, rod_friction: names of the friction family; None where the system has no such contact.
    chambers: "stroke" as in (11) or "constant" as in (6); None for a system without chambers.
    effects: names of effects, applied in this order where two change the same signal.
    system_name: name of the system, a file of `systems/`.
    """

    shaft_friction: str | None = "stribeck"
    rod_friction: str | None = "stribeck"
    chambers: str | None = "stroke"
    effects: tuple[str, ...] = ()
    system_name: str = field(default="ehsa", repr=False)

    def __post_init__(self) -> None:
        if self.system_name not in SYSTEMS:
            raise InputError(f"system = {self.system_name!r} is not known; {choices(self.system_name, SYSTEMS)}")
        contacts = {contact.name for contact in self.system.all_contacts}
        words: list[tuple[str, str | None, Mapping[str, object]]] = [
            ("shaft_friction", self.shaft_friction, LAWS if "shaft" in contacts else {}),
            ("rod_friction", self.rod_friction, LAWS if "rod" in contacts else {}),
            ("chambers", self.chambers, self.system.chamber_forms),
            *(("effects", effect, EFFECTS) for effect in self.effects),
        ]
        for key, name, known in words:
            if name is None and known:
                raise InputError(f"{key} is missing; known: {', '.join(sorted(known))}")
            if name is not None and not known:
                raise InputError(f"{key} = {name!r}: the system {self.system_name!r} has none; leave it out")
            if name is not None and name not in known:
                raise InputError(f"{key} = {name!r} is not known; {choices(name, known)}")
        if len(set(self.effects)) < len(self.effects):
            raise InputError(f"effects = {list(self.effects)} names an effect twice; name each once")
        self._check_fit()

    def _check_fit(self) -> None:
        """Words that are known but do nothing in this system are mistakes too."""
        system = self.system
        for contact in system.prescribed:
            if self.law(contact).state_rate is not None:
                raise InputError(
                    f"{contact.name}_friction = {self.law(contact).name!r}: a law with an inner state needs a motion "
                    f"that is solved for, and {system.name!r} prescribes it; choose another law"
                )
        known = {*(signal for signal, _ in system.equations), *system.inputs, *(state.name for state in system.states)}
        known |= {contact.friction for contact in system.all_contacts}
        known |= {signal for form in system.chamber_forms.values() for signal, _ in form}
        for name in self.effects:
            if not EFFECTS[name].wired:
                raise InputError(f"effects: {name!r} {_instead(EFFECTS[name])}")
            for contact in system.all_contacts:
                self._check_symbols(name, contact)
            if not known.issuperset(EFFECTS[name].changes):
                missing = ", ".join(sorted(set(EFFECTS[name].changes) - known))
                raise InputError(f"effects: {name!r} changes {missing}, which the system {system.name!r} does not have")

    def _check_symbols(self, effect: str, contact: Contact) -> None:
        """An effect may ask for a symbol of friction that the contact's law does not have."""
        functions = (*EFFECTS[effect].changes.values(), *EFFECTS[effect].adds.values())
        asked = {argument for function in functions for argument in inspect.signature(function).parameters}
        for symbol in SYMBOLS:
            name = contact.symbol(symbol)
            if name in asked and symbol not in self.law(contact).symbols:
                raise InputError(
                    f"effects: {effect!r} needs {name}, which {contact.name}_friction = {self.law(contact).name!r} "
                    f"does not have; choose a law that has it"
                )

    def __str__(self) -> str:
        return repr(self) if self.system_name == "ehsa" else f"{self.system_name} {self!r}"

    @property
    def system(self) -> System:
        return SYSTEMS[self.system_name]

    def law(self, contact: Contact) -> FrictionLaw:
        word = self.shaft_friction if contact.name == "shaft" else self.rod_friction
        assert word is not None
        return LAWS[word]

    @property
    def delay(self) -> str | None:
        """The parameter by which the first input acts late; None if it does not."""
        late = [name for name in self.effects if EFFECTS[name].delays]
        return EFFECTS[late[0]].parameters[0].name if late else None

    @property
    def equations(self) -> Equations:
        """The wired equations of this structure (computed once)."""
        return _wire(self)


NONLINEAR = Structure()
LINEAR = Structure(shaft_friction="viscous", rod_friction="viscous", chambers="constant")


@dataclass(frozen=True)
class Call:
    """One equation in its place: `target` is set to function(**arguments); arguments hold names in this list."""

    target: str
    function: ScalarFunction
    arguments: Mapping[str, str]


@dataclass(frozen=True)
class Equations:
    """The equations of one structure, in an order in which they can be evaluated.

    Attributes
    ----------
    states: all states, those of the system first, then inner states of friction laws.
    rates: for each state the signal that is its time derivative.
    inputs: two, what drives the system and what acts from outside: current and outer force for the EHSA.
    directions: sliding direction of each contact, set by the mode the contact is in.
    parameters: what has to be given as numbers, in a fixed order.
    calls: the equations; every argument is a state, input, direction, parameter or an earlier target.
    signals: the last name of each signal, after all effects, e.g. signals["Q_1"] == "Q_1__relief_valve".
    residuals: the system's balances, wired likewise: for each the names of its residuals among `residual_calls`.
    residual_calls: equations that the balances need beyond `calls`; a simulation does without them.
    measured: names that only the residual calls ask for: STATE_rate, CHANNEL_measured, directions of prescribed motion.
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

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    def index(self, state: str) -> int:
        """Position of a state in the state vector. Raises InputError for a state that the system does not have."""
        names = [s.name for s in self.states]
        if state not in names:
            raise InputError(
                f"{state!r} is no state of the system {self.structure.system_name!r}; {choices(state, names)}"
            )
        return names.index(state)


def _instead(effect: Effect) -> str:
    """What to write for an effect that has no equations of its own."""
    if effect.symbols:
        return f"is no equation of its own; set {' or '.join(effect.symbols)} instead"
    if effect.sensor is not None:
        return f"belongs to a sensor; set {effect.sensor}.CHANNEL instead"
    return f'is a friction law; set rod_friction = "{effect.rod_friction}" instead'


class _Wiring:
    """Works from the wanted signals backwards: an equation is placed when everything it needs is there."""

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
            names = {symbol: contact.symbol(symbol) for symbol in SYMBOLS}
            names |= {"direction": contact.direction, "speed": contact.velocity}
            names |= {"z": contact.bristle.name, "z_dot": f"{contact.bristle.name}_dot"}
            self.sources[contact.friction] = (law.effort, names)
            if law.state_rate is not None:
                self.states.append(contact.bristle)
                self.sources[f"{contact.bristle.name}_dot"] = (law.state_rate, names)
            for symbol in law.symbols:
                unit, meaning = SYMBOLS[symbol]
                unit = unit.format(effort=contact.effort_unit, length=contact.length_unit)
                positive = symbol in ("tau", "sigma_0")
                kinds[contact.symbol(symbol)] = ParameterKind(
                    contact.symbol(symbol), unit, f"{meaning}, {contact.name}", 0.0, lower_open=positive
                )
        self.changes: dict[str, list[tuple[str, ScalarFunction]]] = {}
        for name in structure.effects:
            self.states += [State(state.name, state.unit, state.scale) for state in EFFECTS[name].states]
            for signal, function in EFFECTS[name].adds.items():
                self.sources[signal] = (function, {})
        self.held = {f"{c.velocity}_dot": c.direction for c in system.contacts if structure.law(c).sticks}
        for name in structure.effects:
            for signal, function in EFFECTS[name].changes.items():
                self.changes.setdefault(signal, []).append((name, function))
            for parameter in EFFECTS[name].parameters:
                lower, upper = parameter.lower, parameter.upper
                if math.isfinite(parameter.neutral):
                    # Infinity is how "never" is written, and only where that is what leaves the effect out.
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
        # An effect's own state may follow the current that was asked for, while the effect changes the acting one.
        self.placed: dict[str, str] = {f"asked_{name}": name for name in system.inputs}
        self.open: list[str] = []
        self.used: set[str] = set()

    def place(self, name: str) -> str:
        """Return the name under which signal `name` is available, placing the equations that it needs."""
        name = self.structure.system.own(name)
        if name in self.placed:
            return self.placed[name]
        if name in self.open:
            raise TypeError(f"equations need each other in a circle: {' -> '.join([*self.open, name])}")
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
            raise TypeError(f"an equation asks for {name!r}, which is no signal, state, input or parameter")
        for effect, function in self.changes.get(name, ()):
            current = self._call(f"{name}__{effect}", function, {name: current}, ready={name})
        if name in self.held:
            names = {"rate": current, "direction": self.held[name]}
            current = self._call(f"{name}__held", held, names, ready={"rate", "direction"})
        self.open.pop()
        self.placed[name] = current
        return current

    def residuals(self, balance: Balance) -> tuple[str, ...]:
        """Place the residuals of a balance, for which the measured names may be asked; returns their names."""
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
        for argument in inspect.signature(function).parameters:
            source = names.get(argument, argument)
            arguments[argument] = source if ready and argument in ready else self.place(source)
        self.calls.append(Call(target, function, arguments))
        return target


@cache
def _wire(structure: Structure) -> Equations:
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
