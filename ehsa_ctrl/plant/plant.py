"""Plants: structure, parameters with provenance, limits and sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.errors import InputError, choices, shown
from ..core.log import CHANNELS, Column
from ..core.parameter import Parameter, check_range
from ..core.result import Result, as_table
from ..core.unit import read_value, unit_suffix
from ..core.watchdog import Watchdog
from ..physics.effects import EFFECTS, with_extended
from .file import EstimationFile, key_of, label
from .structure import Structure

if TYPE_CHECKING:
    import pandas

#: Settings of a sensor that a user can set and `identify` can estimate: bias in the channel's unit, scale (1 is
#: ideal), delay and filter time constant in s.
SENSOR_WORDS = ("bias", "scale", "delay", "filter")

Model = Literal["linear", "nonlinear"]


@dataclass(frozen=True)
class Sensor:
    """A sensor: scale * (filtered quantity, `delay` seconds ago) + bias + noise, then quantised.

    noise: standard deviation. step: quantisation step. delay: in s. filter: time constant of a first-order low-pass
    [s], 0 for none. stated: numbers of the plant's file, with their provenance.
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
        """Standard deviation of noise and quantisation (step / sqrt(12) for a uniform error) together."""
        return math.hypot(self.noise, self.step / math.sqrt(12.0))

    def __repr__(self) -> str:
        # Baselines hash this text. Older ones know no filter, so it appears only if it is set.
        named = [f.name for f in fields(self) if f.repr and (f.name != "filter" or self.filter != 0.0)]
        return f"Sensor({', '.join(f'{name}={getattr(self, name)!r}' for name in named)})"

    def unit_of(self, word: str) -> str:
        """SI unit of one of SENSOR_WORDS."""
        return {"scale": "1", "delay": "s", "filter": "s"}.get(word, self.unit)


def sensor_unit(name: str) -> str:
    """SI unit of a number of a sensor by its name, such as delay.speed."""
    word, _, channel = name.partition(".")
    return Sensor(channel, CHANNELS[channel].unit).unit_of(word)


@dataclass(frozen=True)
class Plant(Result):
    """A plant for simulation, linearisation and identification.

    Attributes
    ----------
    name: name of the file, without suffix.
    title: one line.
    model: parameter set of the plant, "linear" or "nonlinear".
    structure: friction laws, chamber form, effects.
    parameters: symbol -> parameter, for every symbol of the equations, in their order.
    limits: name in `file.LIMIT_UNITS` -> limit, checked in every run.
    sensors: channel -> sensor.
    sample_time: s.
    free: parameters that `identify` estimates by default.
    estimation: method of `identify`.
    log: channel -> column of this rig's logs, for channels whose name or unit differs.
    log_controller: [log.controller] of the file, the controller under which the logs are recorded; None without one.
    watchdog: safe output when the controller's side of a link is silent.
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
    log_controller: Mapping[str, Any] | None = None
    watchdog: Watchdog = field(default_factory=Watchdog, repr=False)
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
        """State (n_states,) at rest: x = x_0 and P_1 = P_2 = P_0 if the system has them, zero otherwise."""
        start = self.structure.system.start
        states = [state.name for state in self.structure.equations.states]
        return np.array([self[start[name]] if name in start else 0.0 for name in states])

    @property
    def implausible(self) -> tuple[str, ...]:
        """Warnings about values set for one run: outside the file's plausible range, or so far from the file's value
        that the unit is probably wrong."""
        return tuple(
            (p.far and label(p.name) + p.far.removeprefix(p.name).replace(p.name, key_of(p.name)))
            or f"{label(p.name)} = {p.value:g}{unit_suffix(p.unit)} lies outside {p.lower:g} to {p.upper:g}"
            f"{unit_suffix(p.unit)}, the plausible range of {self.name}"
            for p in self.parameters.values()
            if p.source == "given" and (p.far or not p.lower <= p.value <= p.upper)
        )

    def set(self, **values: float | str) -> Plant:
        """The plant with other values, e.g. plant.set(K_S=50e3, K_T=1.1) or plant.set(K_S="50 N/mm").

        Numbers and texts without a unit are in SI units.

        Raises InputError for an unknown symbol, a unit that does not fit, or a physically impossible value.
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
        """The plant with other friction laws, chamber form or effects. values: of parameters that it lacks, SI units.

        Raises InputError for a missing value, and as `set` does.
        """
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
                raise InputError(f"{structure} needs {kind.name} ({kind.meaning}), which has no value; give one")
        kept = {name: known[name] for name in structure.equations.parameter_names}
        return replace(self, structure=structure, parameters=kept).set(**values)

    def with_effects(self, *names: str, **values: float) -> Plant:
        """The plant with added effects and those that they extend.

        values: of their parameters, SI units; by default the typical ones.
        """
        effects = tuple(dict.fromkeys([*self.structure.effects, *with_extended(names)]))
        return self.with_structure(replace(self.structure, effects=effects), **values)

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
