"""The structure of a plant: friction law of each contact, chamber form, effects.

A structure consists of names and is hashable, so compiled engines can be cached by it. Its `equations` are the wired
list that plain evaluation, compiled engine and linearisation share.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from ..core.errors import InputError, choices
from ..core.log import CHANNELS
from ..core.syntax import argument_names
from ..physics.effects import EFFECTS, Effect, effect_of
from ..physics.friction import LAWS, SYMBOLS, FrictionLaw
from .system import Contact, System
from .systems import SYSTEMS
from .wiring import Equations, wire


@dataclass(frozen=True)
class Structure:
    """Names that select the equations.

    Attributes
    ----------
    shaft_friction, rod_friction: friction laws; None if the system has no such contact.
    chambers: "stroke" as in (11) or "constant" as in (6); None for a system without chambers.
    effects: names of effects; if two change the same signal, they act in this order.
    system_name: name of a system of `systems/`.

    Raises InputError for unknown names and for combinations that the system does not allow.
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
                raise InputError(f"{key} = {name!r}: the system {self.system_name!r} has no {key}; leave it out")
            if name is not None and name not in known:
                raise InputError(f"{key} = {name!r} is not known; {choices(name, known)}")
        if len(set(self.effects)) < len(self.effects):
            raise InputError(f"effects = {list(self.effects)} names an effect twice; name each once")
        self._check_fit()

    def _check_fit(self) -> None:
        """Raise InputError for known names that do not fit this system."""
        system = self.system
        for contact in system.prescribed:
            if self.law(contact).state_rate is not None:
                raise InputError(
                    f"{contact.name}_friction = {self.law(contact).name!r}: a law with an inner state needs a "
                    f"simulated motion, but {system.name!r} prescribes this one; choose another law"
                )
        known = {*(signal for signal, _ in system.equations), *system.inputs, *(state.name for state in system.states)}
        known |= {contact.friction for contact in system.all_contacts}
        known |= {signal for form in system.chamber_forms.values() for signal, _ in form}
        self._check_names(known)
        for name in self.effects:
            law = EFFECTS[name].law
            if law is not None:
                law.check(self.units)
            if not EFFECTS[name].wired:
                raise InputError(f"effects: {name!r} {_instead(EFFECTS[name])}")
            extended = EFFECTS[name].extends
            if extended and EFFECTS[extended].wired and extended not in self.effects:
                raise InputError(f"effects: {name!r} extends {extended!r}, which is missing; name both")
            for contact in system.all_contacts:
                self._check_symbols(name, contact)
            if missing_signals := set(system.own_changes(EFFECTS[name].changes)) - known:
                missing = ", ".join(sorted(missing_signals))
                raise InputError(f"effects: {name!r} changes {missing}, which the system {system.name!r} does not have")

    @property
    def units(self) -> dict[str, str]:
        """State, input, direction, effort on a contact or parameter -> SI unit.

        Also under the names that the catalogue of effects uses.
        """
        system = self.system
        units = {state.name: state.unit for state in system.states}
        units |= {name: system.units.get(c) or CHANNELS[c].unit for name, c in system.drives.items()}
        for balance in system.balances:
            units |= {one.target: balance.unit for one in balance.entries if one.target in system.inputs[1:]}
        units |= {kind.name: kind.unit for kind in system.parameters}
        for contact in system.all_contacts:
            units |= {contact.direction: "1", contact.velocity: f"{contact.length_unit}/s"}
            units |= dict.fromkeys(contact.efforts, contact.effort_unit)
            for symbol, part in self.law(contact).symbols.items():
                units[contact.symbol(symbol)] = part.unit_at(contact.effort_unit, contact.length_unit)
        catalogue = [*system.symbols, *(f"{s}_{c.suffix}" for c in system.all_contacts for s in c.symbols)]
        return units | {name: units[system.own(name)] for name in catalogue if system.own(name) in units}

    def _check_names(self, known: Set[str]) -> None:
        """Raise InputError if the system already has a name that a friction law or an effect adds."""
        system = self.system
        taken = dict.fromkeys([*known, *(p.name for p in system.parameters)], f"the system {system.name!r}")
        for contact in system.all_contacts:
            law = self.law(contact)
            for symbol in law.symbols:
                name = contact.symbol(symbol)
                if name in taken:
                    raise InputError(
                        f"{contact.name}_friction = {law.name!r}: its parameter {symbol!r} becomes {name}, which is "
                        f"also a name of {taken[name]}; rename it in the law"
                    )
                taken[name] = f"the friction law {law.name!r}"
        for effect in self.effects:
            for name in [p.name for p in EFFECTS[effect].parameters] + [s.name for s in EFFECTS[effect].states]:
                if name in taken:
                    raise InputError(
                        f"effects: {name!r} of {effect!r} is also a name in {taken[name]}; rename one of them"
                    )
                taken[name] = f"the effect {effect!r}"

    def _check_symbols(self, effect: str, contact: Contact) -> None:
        """Raise InputError for an effect that needs a friction parameter which the law of the contact lacks."""
        functions = (*EFFECTS[effect].changes.values(), *EFFECTS[effect].adds.values())
        asked = {argument for function in functions for argument in argument_names(function)}
        for symbol in SYMBOLS:
            name = contact.symbol(symbol)
            if name in asked and symbol not in self.law(contact).symbols:
                raise InputError(
                    f"effects: {effect!r} needs {name}, which {contact.name}_friction = {self.law(contact).name!r} "
                    f"does not have; choose a law that has it"
                )

    def __str__(self) -> str:
        return repr(self) if self.system_name == "ehsa" else f"{self.system_name} {self!r}"

    @cached_property
    def system(self) -> System:
        return SYSTEMS[self.system_name]

    def law(self, contact: Contact) -> FrictionLaw:
        word = self.shaft_friction if contact.name == "shaft" else self.rod_friction
        assert word is not None
        return LAWS[word]

    @property
    def delay(self) -> str | None:
        """Parameter with the dead time of the first input; None without a dead time."""
        late = [name for name in self.effects if EFFECTS[name].delays]
        return EFFECTS[late[0]].parameters[0].name if late else None

    @cached_property
    def equations(self) -> Equations:
        """The wired equations of this structure; they stay as they are when a file of a project changes."""
        return wire(self, self.parts)

    def __getstate__(self) -> dict[str, object]:
        """The names, and laws that this process alone knows: another process wires them again."""
        kept = {name: EFFECTS[name].law for name in self.effects if name not in EFFECTS.members()}
        return {one.name: getattr(self, one.name) for one in fields(self)} | {"kept": kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, law in state["kept"].items():
            if law is not None:
                EFFECTS.keep(name, effect_of(name, law.definition, law.where))
        vars(self).update({name: value for name, value in state.items() if name != "kept"})

    @property
    def parts(self) -> tuple[object, ...]:
        """What the names stand for: the system, the friction laws and the effects."""
        laws = LAWS.members()
        return (
            self.system,
            *(laws[name] for name in (self.shaft_friction, self.rod_friction) if name is not None),
            # A project's effects are not executed for a plant that has none.
            *(EFFECTS[name] for name in self.effects),
        )


NONLINEAR = Structure()
LINEAR = Structure(shaft_friction="viscous", rod_friction="viscous", chambers="constant")


def _instead(effect: Effect) -> str:
    """The remedy for an effect without equations."""
    if effect.symbols:
        return f"has no equation of its own; set {' or '.join(effect.symbols)} instead"
    if effect.sensor is not None:
        return f"is a sensor error; set {effect.sensor}.CHANNEL instead"
    return f'is a friction law; set rod_friction = "{effect.rod_friction}" instead'
