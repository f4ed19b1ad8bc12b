"""Plants: structure, parameters with provenance, limits and sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..core.errors import InputError, choices, shown
from ..core.log import Column
from ..core.parameter import Parameter, check_range
from ..core.result import Result, as_table
from ..core.unit import read_value
from ..physics.effects import EFFECTS
from .file import EstimationFile, key_of, label
from .structure import Structure

if TYPE_CHECKING:
    import pandas

#: Settings of a sensor that can be set and estimated: bias in the channel's unit, scale (1 is neutral), delay and
#: filter in s.
SENSOR_WORDS = ("bias", "scale", "delay", "filter")

Model = Literal["linear", "nonlinear"]


@dataclass(frozen=True)
class Sensor:
    """A sensor: scale * (filtered quantity, `delay` seconds ago) + bias + noise, then quantised.

    noise: standard deviation. step: quantisation. filter: time constant of a first-order low-pass, 0 for none.
    stated: the numbers of the plant's file with their provenance.
    """

    channel: str
    unit: str
    noise: float = 0.0
    step: float = 0.0
    delay: float = 0.0
    scale: float = 1.0
    bias: float = 0.0
    filter: float = 0.0
    stated: tuple[Parameter, ...] = field(default=(), compare=False, repr=False)

    @property
    def sd(self) -> float:
        """Standard deviation of noise and rounding together."""
        return math.hypot(self.noise, self.step / math.sqrt(12.0))

    def __repr__(self) -> str:
        # Baselines hash this text, so a filter appears only where there is one.
        named = [f.name for f in fields(self) if f.repr and (f.name != "filter" or self.filter != 0.0)]
        return f"Sensor({', '.join(f'{name}={getattr(self, name)!r}' for name in named)})"

    def unit_of(self, word: str) -> str:
        """SI unit of one of SENSOR_WORDS."""
        return {"scale": "1", "delay": "s", "filter": "s"}.get(word, self.unit)


@dataclass(frozen=True)
class Plant(Result):
    """A plant for simulation, linearisation and identification.

    Attributes
    ----------
    name: of the file, without ending. title: one line.
    model: parameter set of the plant, "linear" or "nonlinear".
    structure: friction laws, chamber form, effects.
    parameters: every symbol of the equations, in their order.
    limits: checked in every run, by the names of `file.LIMIT_UNITS`.
    sensors: by channel.
    sample_time: s.
    free: parameters that `identify` estimates by default. estimation: its method.
    log: channel -> column of this rig's logs, where name or unit differ.
    path: the file.
    """

    name: str
    title: str
    model: Model
    structure: Structure
    parameters: Mapping[str, Parameter]
    limits: Mapping[str, Parameter]
    sensors: Mapping[str, Sensor]
    sample_time: float
    free: tuple[str, ...] = ()
    estimation: EstimationFile = field(default_factory=EstimationFile)
    log: Mapping[str, Column] = field(default_factory=dict)
    path: Path | None = field(default=None, compare=False)

    def __getitem__(self, symbol: str) -> float:
        """Value of a parameter in SI units: plant["K_T"]. Raises InputError for an unknown symbol."""
        try:
            return self.parameters[symbol].value
        except (KeyError, TypeError):
            raise InputError(
                f"the {self.model} model of {self.name} has no parameter {shown(symbol)}; "
                f"{choices(symbol, self.parameters)}"
            ) from None

    @property
    def values(self) -> dict[str, float]:
        """All parameter values in SI units."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @property
    def vector(self) -> np.ndarray:
        """Parameter values (n_parameters,) in the order of `structure.equations.parameters`."""
        return np.array([self[name] for name in self.structure.equations.parameter_names])

    @property
    def rest(self) -> np.ndarray:
        """State (n_states,) at rest: x = x_0, P_1 = P_2 = P_0, as far as the system has them."""
        start = self.structure.system.start
        states = [state.name for state in self.structure.equations.states]
        return np.array([self[start[name]] if name in start else 0.0 for name in states])

    @property
    def implausible(self) -> tuple[str, ...]:
        """Warnings about values set for one run: outside the file's range, or so far from the file's value that another
        unit was probably meant."""
        return tuple(
            (p.far and label(p.name) + p.far.removeprefix(p.name).replace(p.name, key_of(p.name)))
            or f"{label(p.name)} = {p.value:g} {p.unit} lies outside {p.lower:g} to {p.upper:g} {p.unit}, the "
            f"plausible range of {self.name}"
            for p in self.parameters.values()
            if p.source == "given" and (p.far or not p.lower <= p.value <= p.upper)
        )

    def set(self, **values: float | str) -> Plant:
        """The plant with other values, e.g. plant.set(K_S=50e3, K_T=1.1) or plant.set(K_S="50 N/mm").

        Numbers are in SI units; a text has a unit.

        Raises InputError for an unknown symbol, a unit that does not fit or a value that is physically impossible.
        """
        kinds = {kind.name: kind for kind in self.structure.equations.parameters}
        changed = dict(self.parameters)
        for name, value in values.items():
            if name not in kinds:
                raise InputError(
                    f"the {self.model} model of {self.name} has no parameter {name!r}; {choices(name, kinds)}"
                )
            kind = kinds[name]
            try:
                value = read_value(value, kind.unit)
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
            check_range(name, value, kind.unit, kind.lower, kind.upper, lower_open=kind.lower_open)
            changed[name] = changed[name].given(value)
        return replace(self, parameters=changed)

    def with_structure(self, structure: Structure, **values: float) -> Plant:
        """The plant with other friction laws, chamber form or effects; `values` for symbols that it lacks."""
        known = dict(self.parameters)
        for kind in structure.equations.parameters:
            if kind.name in known:
                continue
            default = effect_default(structure, kind.name)
            if kind.name in values:
                known[kind.name] = Parameter(kind.name, values[kind.name], kind.unit, "given")
            elif default is not None:
                known[kind.name] = default
            else:
                raise InputError(f"{kind.name} ({kind.meaning}) is needed by {structure} and has no value; give it")
        kept = {name: known[name] for name in structure.equations.parameter_names}
        return replace(self, structure=structure, parameters=kept).set(**values)

    def with_effects(self, *names: str, **values: float) -> Plant:
        """The plant with added effects, at their typical parameters unless given."""
        added = tuple(name for name in names if name not in self.structure.effects)
        return self.with_structure(replace(self.structure, effects=self.structure.effects + added), **values)

    def __str__(self) -> str:
        structure = self.structure
        lines = [
            f"{self.name} ({self.model}): {self.title}",
            "  friction: " + ", ".join(f"{c.name} {structure.law(c).name}" for c in structure.system.all_contacts),
        ]
        if structure.chambers is not None:
            lines.append(f"  chambers: {structure.chambers}")
        if structure.effects:
            lines.append(f"  effects: {', '.join(structure.effects)}")
        lines += [f"  {label(p.name):<22} {p.value:>12.6g} {p.unit:<10} {p.source}" for p in self.parameters.values()]
        return "\n".join(lines)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per parameter: value in SI units, unit, source, sd, range of plausible values, note."""
        return as_table(self.parameters.values(), "value unit source sd lower upper note")


def effect_default(structure: Structure, name: str) -> Parameter | None:
    """Typical value of a parameter of the structure's effects; None for any other parameter."""
    for effect in structure.effects:
        for parameter in EFFECTS[effect].parameters:
            if parameter.name == name:
                return Parameter(name, parameter.typical, parameter.unit, parameter.source, note=f"typical of {effect}")
    return None
