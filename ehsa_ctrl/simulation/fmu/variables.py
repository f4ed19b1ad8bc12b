"""Variables of the FMU: inputs, outputs and parameters by name, with unit, meaning and range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

from ...plant.plant import Plant

#: Input of a system -> unit and meaning.
INPUTS = {
    "current": ("A", "motor current; positive extends the rod"),
    "F_D": ("N", "external force in addition to the load; positive when it resists positive motion"),
    "F_M": ("N", "drive force; positive moves the carriage forward"),
    "v": ("m/s", "prescribed velocity of the rod; positive extends"),
}

#: State -> channel of the log, and meaning.
CHANNELS = {
    "omega": ("speed", "shaft speed omega"),
    "P_1": ("p1", "pressure in chamber 1, gauge"),
    "P_2": ("p2", "pressure in chamber 2, gauge"),
    "v": ("velocity", "velocity v; positive extends the rod"),
    "x": ("position", "position x; positive extends the rod"),
}

#: Bounds and values beyond this mean "none" or "never" and are not exported; see `core.definition.LARGEST`.
ENDLESS = 1e29


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU. signal: its name in the equations. lower, upper: None without a bound."""

    name: str
    kind: str
    unit: str
    meaning: str
    signal: str
    start: float | None = None
    lower: float | None = None
    upper: float | None = None


def variables_of(plant: Plant) -> tuple[Variable, ...]:
    """Inputs, outputs, parameters, in this order; SI units.

    Inputs and parameters have the symbols of the equations; outputs have the names of log channels, if there is one.
    `shaft_sticks` and `rod_sticks` are true during sticking. Outputs are true signals, without sensors.

    Infinite parameters ("never") are left out, because tools can't write them.
    """
    return (*_inputs(plant), *_outputs(plant), *_parameters(plant))


def _inputs(plant: Plant) -> Iterator[Variable]:
    for name in plant.structure.system.inputs:
        unit, meaning = INPUTS.get(name, ("1", f"input {name} of the system"))
        yield Variable(name, "input", unit, meaning, name, start=0.0)


def _outputs(plant: Plant) -> Iterator[Variable]:
    structure = plant.structure
    own = {state.name for state in structure.system.states}
    for state in structure.equations.states:
        inner = "inner state of a friction law or an effect"
        name, meaning = CHANNELS[state.name] if state.name in own else (state.name, inner)
        yield Variable(name, "output", state.unit, meaning, state.name)
    if structure.system.cell is not None:
        meaning = "force in the load cell between rod and load, positive when it resists extension"
        yield Variable("force", "output", "N", meaning, "F_cell")
    for contact in structure.system.contacts:
        if structure.law(contact).sticks:
            meaning = f"friction holds the {contact.name} at rest"
            yield Variable(f"{contact.name}_sticks", "flag", "", meaning, contact.name)


def _parameters(plant: Plant) -> Iterator[Variable]:
    for kind in plant.structure.equations.parameters:
        nominal = plant.parameters[kind.name]
        if abs(nominal.value) > ENDLESS or not isfinite(nominal.value):
            continue
        source = f"{kind.meaning} ({nominal.source})" if nominal.source else kind.meaning
        lower = kind.lower if abs(kind.lower) < ENDLESS else None
        upper = kind.upper if abs(kind.upper) < ENDLESS else None
        yield Variable(kind.name, "parameter", kind.unit, source, kind.name, nominal.value, lower, upper)
