"""A plant: a structure, its parameters with provenance, its limits and its sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.catalogue import plants
from ..core.definition import read_definition
from ..core.errors import InputError, choices, shown
from ..core.log import CHANNELS, Column
from ..core.parameter import Parameter, check_range
from ..core.registry import add_project
from ..core.text import TextResult
from ..core.unit import parse
from ..physics.effects import EFFECTS
from .file import (
    CHANNEL_UNITS,
    LIMIT_STATES,
    LIMIT_UNITS,
    LOAD_SYMBOLS,
    EstimationFile,
    ModelFile,
    PlantFile,
    Quantity,
    SensorFile,
    both,
    key_of,
    symbol_of,
)
from .structure import Structure

if TYPE_CHECKING:
    import pandas

#: What of a sensor can be set and estimated: bias in the channel's unit, scale (1 is neutral), delay and filter in s.
SENSOR_WORDS = ("bias", "scale", "delay", "filter")

#: The least of a limit that may be negative, and the largest of any; beyond it nothing is limited.
LEAST, MOST = {"pressure_min": -1e6}, 1e30

Model = Literal["linear", "nonlinear"]


@dataclass(frozen=True)
class Sensor:
    """One channel of the bench: scale * (what it measures, filtered, `delay` seconds ago) + bias, noisy, then rounded.

    noise is one standard deviation, step that of the converter, filter the time constant of a first-order one (0:
    none). `stated` are these numbers as the plant's file has them, with their provenance.
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
        # Baselines know a plant by these words: what most sensors don't have is said of those that have it.
        said = [f for f in fields(self) if f.repr and (f.name != "filter" or self.filter != 0.0)]
        return f"Sensor({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in said)})"

    def unit_of(self, word: str) -> str:
        """SI unit of one of SENSOR_WORDS."""
        return {"scale": "1", "delay": "s", "filter": "s"}.get(word, self.unit)


@dataclass(frozen=True)
class Plant(TextResult):
    """A plant that can be simulated, linearised, identified.

    Attributes
    ----------
    name: the file's name without ending.
    title: one line.
    model: "linear" or "nonlinear", which of the plant's two parameter sets this is.
    structure: friction laws, chamber form, effects.
    parameters: every symbol of the equations, in their order.
    limits: what is watched in a run, by the names of `file.LIMIT_UNITS`.
    sensors: by channel.
    sample_time: s.
    free: what `identify` estimates unless told otherwise: `free` of the file's model, or what it calls identified.
    estimation: how it does.
    log: channel -> where this rig's logs keep it, if not under its own name and in SI units.
    path: the file it was read from.
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
        """Value of a parameter in SI units: plant["K_T"]. Raises InputError for a symbol that it does not have."""
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
        """Sentences on values that were set for one run and lie outside the range in which the file believes them, or
        so far from the file's own that another unit must be meant."""
        return tuple(
            (p.far and both(p.name) + p.far.removeprefix(p.name).replace(p.name, key_of(p.name)))
            or f"{both(p.name)} = {p.value:g} {p.unit} lies outside {p.lower:g} to {p.upper:g} {p.unit}, the range in "
            f"which {self.name} believes it"
            for p in self.parameters.values()
            if p.source == "given" and (p.far or not p.lower <= p.value <= p.upper)
        )

    def set(self, **values: float | str) -> Plant:
        """The same plant with other values, e.g. plant.set(K_S=50e3, K_T=1.1) or plant.set(K_S="50 N/mm").

        Numbers are in SI units; a text has its unit.

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
                value = _number(value, kind.unit)
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
            check_range(name, value, kind.unit, kind.lower, kind.upper, lower_open=kind.lower_open)
            changed[name] = changed[name].given(value)
        return replace(self, parameters=changed)

    def with_structure(self, structure: Structure, **values: float) -> Plant:
        """The same plant with other friction laws, chamber form or effects; `values` gives symbols it lacks."""
        known = dict(self.parameters)
        for kind in structure.equations.parameters:
            if kind.name in known:
                continue
            default = _effect_default(structure, kind.name)
            if kind.name in values:
                known[kind.name] = Parameter(kind.name, values[kind.name], kind.unit, "given")
            elif default is not None:
                known[kind.name] = default
            else:
                raise InputError(f"{kind.name} ({kind.meaning}) is needed by {structure} and has no value; give it")
        kept = {name: known[name] for name in structure.equations.parameter_names}
        return replace(self, structure=structure, parameters=kept).set(**values)

    def with_effects(self, *names: str, **values: float) -> Plant:
        """The same plant with effects added, at their typical parameters unless given."""
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
        lines += [f"  {both(p.name):<22} {p.value:>12.6g} {p.unit:<10} {p.source}" for p in self.parameters.values()]
        return "\n".join(lines)

    def to_pandas(self) -> pandas.DataFrame:
        """One row a parameter: value in SI units, unit, source, sd, the range in which it is believed, note."""
        import pandas

        words = ("value", "unit", "source", "sd", "lower", "upper", "note")
        rows = {p.name: {word: getattr(p, word) for word in words} for p in self.parameters.values()}
        return pandas.DataFrame.from_dict(rows, orient="index", columns=list(words)).rename_axis("name")


def _effect_default(structure: Structure, name: str) -> Parameter | None:
    for effect in structure.effects:
        for parameter in EFFECTS[effect].parameters:
            if parameter.name == name:
                return Parameter(name, parameter.typical, parameter.unit, parameter.source, note=f"typical of {effect}")
    return None


def load_plant(
    name: str | Path, *, model: Model = "nonlinear", settings: Mapping[str, str | float] | None = None
) -> Plant:
    """Load a plant by catalogue name or by the path of a TOML file.

    Parameters
    ----------
    name: e.g. "ehsa" or "my/rig.toml".
    model: which of the plant's parameter sets.
    settings: what is believed for one run, as on the command line: {"K_T": 1.1, "load.stiffness": "50 N/mm"}. Numbers
        and text without a unit are in SI units.

    Raises
    ------
    InputError: the file is absent or wrong, or a setting is; one sentence with file and key.
    """
    path = plants.find(name)
    add_project(path)
    file = read_definition(path, PlantFile)
    part: ModelFile | None = getattr(file, model, None)
    if part is None:
        known = [word for word in ("linear", "nonlinear") if getattr(file, word) is not None]
        if model == "linear" and known:
            raise InputError(
                f"{path}: has no [linear] model, on which controllers are designed; it has [{known[0]}] alone"
            )
        raise InputError(f"{path}: has no [{model}] model; {choices(model, known)}")
    try:
        structure = Structure(part.shaft_friction, part.rod_friction, part.chambers, tuple(part.effects), file.system)
    except InputError as error:
        raise InputError(f"{path}: [{model}] {error}") from None
    plant = Plant(
        name=path.stem,
        title=file.title,
        model=model,
        structure=structure,
        parameters=_parameters(path, file, part, model, structure),
        limits=_limits(path, file, structure),
        sensors=_sensors(path, file, structure),
        free=_free(path, file, part, model, structure),
        estimation=part.estimation,
        log=_log_columns(path, file),
        sample_time=file.sampling.period.parameter("period", "s", f"{path}: [sampling] period").value,
        path=path,
    )
    check_range(f"{path}: [sampling] period.value", plant.sample_time, "s", 0.0, 1.0, lower_open=True)
    return with_settings(plant, settings or {})


def models_of(name: str | Path) -> tuple[Model, ...]:
    """Which parameter sets a plant's file has. Raises InputError as load_plant does."""
    file = read_definition(plants.find(name), PlantFile)
    words: tuple[Model, ...] = ("linear", "nonlinear")
    return tuple(word for word in words if getattr(file, word) is not None)


def with_settings(plant: Plant, settings: Mapping[str, str | float]) -> Plant:
    """The plant as it is believed for one run: symbols, load.WORD, and WORD.CHANNEL for the words of a sensor.

    Raises InputError naming the key.
    """
    sensors, symbols = dict(plant.sensors), {}
    for key, given in settings.items():
        if not is_of_sensor(key):
            symbols[key] = given
            continue
        word, _, channel = key.partition(".")
        if channel not in sensors:
            raise InputError(f"{key}: {plant.name} has no sensor {channel!r}; {choices(channel, sensors)}")
        unit = sensors[channel].unit_of(word)
        try:
            value = _number(given, unit)
            _check_sensor(key, word, value, unit)
        except InputError as error:
            raise InputError(str(error) if str(error).startswith(key) else f"{key}: {error}") from None
        changed: dict[str, Any] = {word: value}
        sensors[channel] = replace(sensors[channel], **changed)
    return replace(plant, sensors=sensors).set(**read_settings(plant, symbols))


def is_of_sensor(key: str) -> bool:
    """Whether a setting is a sensor's: bias.p1, delay.speed."""
    word, dot, _ = key.partition(".")
    return bool(dot) and word in SENSOR_WORDS


def knows(plant: Plant, key: str) -> bool:
    """Whether a setting means something to this model: each has sensors, A_FR only the nonlinear one."""
    return is_of_sensor(key) or symbol_of(key) in plant.parameters


def read_settings(plant: Plant, settings: Mapping[str, str | float]) -> dict[str, float]:
    """Turn {"load.stiffness": "50 N/mm"} into {"K_S": 5e4}. Raises InputError naming the key."""
    kinds = {kind.name: kind for kind in plant.structure.equations.parameters}
    values = {}
    for key, given in settings.items():
        symbol = symbol_of(key)
        if symbol not in kinds:
            known = choices(key, map(key_of, kinds))
            raise InputError(f"{key}: the {plant.model} model of {plant.name} has no such parameter; {known}")
        try:
            values[symbol] = _number(given, kinds[symbol].unit)
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
    return values


def _number(given: str | float, unit: str) -> float:
    if isinstance(given, str):
        try:
            return float(given)
        except ValueError:
            return parse(given, unit)
    if isinstance(given, int | float | np.number) and not isinstance(given, bool | np.complexfloating):
        with suppress(OverflowError):
            return float(given)
    raise InputError(f"is {shown(given)}; expected a number in {unit}, or a text with its unit, as '3 {unit}'")


def _parameters(path: Path, file: PlantFile, part: ModelFile, model: str, structure: Structure) -> dict[str, Parameter]:
    """Collect every symbol that the structure needs, checked against its physical range."""
    kinds = {kind.name: kind for kind in structure.equations.parameters}
    written: dict[str, tuple[str, Quantity]] = {}
    for name, quantity in file.parameters.items():
        written[name] = (f"{path}: [parameters] {name}", quantity)
    for word, quantity in file.load.items():
        written[LOAD_SYMBOLS[word]] = (f"{path}: [load] {word}", quantity)
    for name, quantity in part.parameters.items():
        written[name] = (f"{path}: [{model}.parameters] {name}", quantity)
    found = {}
    for name, (where, quantity) in written.items():
        if name not in kinds:
            raise InputError(f"{where}: unknown parameter of this structure; {choices(name, kinds)}")
        kind = kinds[name]
        parameter = quantity.parameter(name, kind.unit, where)
        check_range(where, parameter.value, kind.unit, kind.lower, kind.upper, lower_open=kind.lower_open)
        found[name] = parameter
    for name, kind in kinds.items():
        if name in found:
            continue
        default = _effect_default(structure, name)
        if default is not None:
            found[name] = default
        elif name in LOAD_SYMBOLS.values():
            found[name] = Parameter(name, 0.0, kind.unit, "assumed", note="no load is given")
        else:
            raise InputError(f"{path}: [{model}.parameters] {name} ({kind.meaning}, {kind.unit}) is missing")
    return {name: found[name] for name in kinds}


def _free(path: Path, file: PlantFile, part: ModelFile, model: str, structure: Structure) -> tuple[str, ...]:
    """What `identify` estimates by default, in the order of the equations."""
    known = structure.equations.parameter_names
    if part.free is None:
        written = {**file.parameters, **part.parameters}
        # What never happens can't be moved.
        identified = {name for name, q in written.items() if q.source == "identified" and math.isfinite(q.value)}
        # A dead time has no derivative to be estimated by.
        return tuple(name for name in known if name in identified and name != structure.delay)
    for name in part.free:
        if name not in known:
            raise InputError(f"{path}: [{model}] free: {name!r} is no parameter of this model; {choices(name, known)}")
    return tuple(part.free)


def _limits(path: Path, file: PlantFile, structure: Structure) -> dict[str, Parameter]:
    limits = {}
    states = [state.name for state in structure.system.states]
    for name, quantity in file.limits.items():
        if name not in LIMIT_UNITS:
            raise InputError(f"{path}: [limits] {name}: unknown limit; {choices(name, LIMIT_UNITS)}")
        if LIMIT_STATES[name] not in states:
            raise InputError(f"{path}: [limits] {name}: the system {file.system!r} has no such thing; leave it out")
        where, unit = f"{path}: [limits] {name}", LIMIT_UNITS[name]
        limits[name] = quantity.parameter(name, unit, where)
        check_range(where, limits[name].value, unit, LEAST.get(name, 0.0), MOST, lower_open=name not in LEAST)
    return limits


def _log_columns(path: Path, file: PlantFile) -> dict[str, Column]:
    columns = {}
    for channel, at in file.log.items():
        if channel not in CHANNELS:
            raise InputError(f"{path}: [log] {channel}: unknown channel; {choices(channel, CHANNELS)}")
        try:
            columns[channel] = Column(at.column, at.scale, at.offset)
        except InputError as error:
            raise InputError(f"{path}: [log] {channel}: {error}") from None
    return columns


def _sensors(path: Path, file: PlantFile, structure: Structure) -> dict[str, Sensor]:
    known = structure.system.channels
    for channel in file.sensors:
        if channel not in known:
            raise InputError(f"{path}: [sensors.{channel}]: unknown channel; {choices(channel, known)}")
    return {channel: _sensor(path, channel, file.sensors.get(channel)) for channel in known}


def _sensor(path: Path, channel: str, sensor: SensorFile | None) -> Sensor:
    unit = CHANNEL_UNITS[channel]
    if sensor is None:
        return Sensor(channel, unit)
    values: dict[str, float] = {}
    stated = []
    for name, quantity, si in (
        ("noise", sensor.noise, unit),
        ("step", sensor.step, unit),
        ("filter", sensor.filter, "s"),
        ("delay", sensor.delay, "s"),
        ("scale", sensor.scale, "1"),
        ("bias", sensor.bias, unit),
    ):
        if quantity is not None:
            where = f"{path}: [sensors.{channel}] {name}"
            stated.append(quantity.parameter(f"{channel} {name}", si, where))
            values[name] = stated[-1].value
            _check_sensor(where, name, values[name], si)
    return Sensor(channel, unit, stated=tuple(stated), **values)


def _check_sensor(where: str, word: str, value: float, unit: str) -> None:
    if not math.isfinite(value):
        raise InputError(f"{where} = {value:g} {unit}: a sensor's {word} must be a finite number")
    lower = 0.0 if word != "bias" else float("-inf")
    check_range(where, value, unit, lower, float("inf"), lower_open=word == "scale")
