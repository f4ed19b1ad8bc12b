"""A plant: a structure, its parameters with provenance, its limits and its sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..core.catalogue import plants
from ..core.definition import read_definition
from ..core.errors import InputError, choices
from ..core.parameter import Parameter, check_range
from ..core.unit import parse
from ..physics.effects import EFFECTS
from .file import CHANNEL_UNITS, LIMIT_UNITS, LOAD_LETTERS, ModelFile, PlantFile, Quantity, SensorFile
from .structure import Structure

Model = Literal["linear", "nonlinear"]


@dataclass(frozen=True)
class Sensor:
    """One channel of the bench: white noise (one standard deviation), converter step (0: none) and delay in s."""

    channel: str
    unit: str
    noise: float = 0.0
    step: float = 0.0
    delay: float = 0.0


@dataclass(frozen=True)
class Plant:
    """A plant that can be simulated, linearised, identified.

    Attributes
    ----------
    name: the file's name without ending.
    title: one line.
    model: "linear" or "nonlinear", which of the plant's two parameter sets this is.
    structure: friction laws, chamber form, effects.
    parameters: every letter of the equations, in their order.
    limits: what is watched in a run, by the names of `file.LIMIT_UNITS`.
    sensors: by channel.
    sample_time: s.
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
    path: Path | None = field(default=None, compare=False)

    def __getitem__(self, letter: str) -> float:
        """Value of a parameter in SI units: plant["K_T"]."""
        return self.parameters[letter].value

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
        """State (n_states,) at rest: x = x_0, P_1 = P_2 = P_0."""
        start = {"P_1": self["P_0"], "P_2": self["P_0"], "x": self["x_0"]}
        return np.array([start.get(state.name, 0.0) for state in self.structure.equations.states])

    def set(self, **values: float) -> Plant:
        """The same plant with other values (SI units), e.g. plant.set(K_S=50e3, K_T=1.1).

        Raises InputError for an unknown letter or a value that is physically impossible.
        """
        kinds = {kind.name: kind for kind in self.structure.equations.parameters}
        changed = dict(self.parameters)
        for name, value in values.items():
            if name not in kinds:
                raise InputError(
                    f"the {self.model} model of {self.name} has no parameter {name!r}; {choices(name, kinds)}"
                )
            kind = kinds[name]
            check_range(name, value, kind.unit, kind.lower, kind.upper, lower_open=kind.lower_open)
            changed[name] = changed[name].given(value)
        return replace(self, parameters=changed)

    def with_structure(self, structure: Structure, **values: float) -> Plant:
        """The same plant with other friction laws, chamber form or effects; `values` gives letters it lacks."""
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
            f"  friction: shaft {structure.shaft_friction}, rod {structure.rod_friction}",
            f"  chambers: {structure.chambers}",
        ]
        if structure.effects:
            lines.append(f"  effects: {', '.join(structure.effects)}")
        lines += [f"  {p.name:<10} {p.value:>12.6g} {p.unit:<10} {p.source}" for p in self.parameters.values()]
        return "\n".join(lines)


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
    file = read_definition(path, PlantFile)
    part: ModelFile | None = getattr(file, model, None)
    if part is None:
        known = [word for word in ("linear", "nonlinear") if getattr(file, word) is not None]
        raise InputError(f"{path}: has no [{model}] model; {choices(model, known)}")
    try:
        structure = Structure(part.shaft_friction, part.rod_friction, part.chambers, tuple(part.effects))
    except InputError as error:
        raise InputError(f"{path}: [{model}] {error}") from None
    plant = Plant(
        name=path.stem,
        title=file.title,
        model=model,
        structure=structure,
        parameters=_parameters(path, file, part, model, structure),
        limits=_limits(path, file),
        sensors=_sensors(path, file),
        sample_time=file.sampling.period.parameter("period", "s", f"{path}: [sampling] period").value,
        path=path,
    )
    check_range(f"{path}: [sampling] period.value", plant.sample_time, "s", 0.0, 1.0, lower_open=True)
    return plant.set(**read_settings(plant, settings or {}))


def read_settings(plant: Plant, settings: Mapping[str, str | float]) -> dict[str, float]:
    """Turn {"load.stiffness": "50 N/mm"} into {"K_S": 5e4}. Raises InputError naming the key."""
    kinds = {kind.name: kind for kind in plant.structure.equations.parameters}
    words = {f"load.{word}": letter for word, letter in LOAD_LETTERS.items()}
    values = {}
    for key, given in settings.items():
        letter = words.get(key, key)
        if letter not in kinds:
            known = [*words, *(name for name in kinds if name not in words.values())]
            raise InputError(
                f"{key}: the {plant.model} model of {plant.name} has no such parameter; {choices(key, known)}"
            )
        try:
            values[letter] = _number(given, kinds[letter].unit)
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
    return values


def _number(given: str | float, unit: str) -> float:
    if isinstance(given, str):
        try:
            return float(given)
        except ValueError:
            return parse(given, unit)
    return float(given)


def _parameters(path: Path, file: PlantFile, part: ModelFile, model: str, structure: Structure) -> dict[str, Parameter]:
    """Collect every letter that the structure needs, checked against its physical range."""
    kinds = {kind.name: kind for kind in structure.equations.parameters}
    written: dict[str, tuple[str, Quantity]] = {}
    for name, quantity in file.parameters.items():
        written[name] = (f"{path}: [parameters] {name}", quantity)
    for word, quantity in file.load.items():
        written[LOAD_LETTERS[word]] = (f"{path}: [load] {word}", quantity)
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
        elif name in LOAD_LETTERS.values():
            found[name] = Parameter(name, 0.0, kind.unit, "assumed", note="no load is given")
        else:
            raise InputError(f"{path}: [{model}.parameters] {name} ({kind.meaning}, {kind.unit}) is missing")
    return {name: found[name] for name in kinds}


def _limits(path: Path, file: PlantFile) -> dict[str, Parameter]:
    limits = {}
    for name, quantity in file.limits.items():
        if name not in LIMIT_UNITS:
            raise InputError(f"{path}: [limits] {name}: unknown limit; {choices(name, LIMIT_UNITS)}")
        limits[name] = quantity.parameter(name, LIMIT_UNITS[name], f"{path}: [limits] {name}")
    return limits


def _sensors(path: Path, file: PlantFile) -> dict[str, Sensor]:
    for channel in file.sensors:
        if channel not in CHANNEL_UNITS:
            raise InputError(f"{path}: [sensors.{channel}]: unknown channel; {choices(channel, CHANNEL_UNITS)}")
    return {channel: _sensor(path, channel, file.sensors.get(channel)) for channel in CHANNEL_UNITS}


def _sensor(path: Path, channel: str, sensor: SensorFile | None) -> Sensor:
    unit = CHANNEL_UNITS[channel]
    if sensor is None:
        return Sensor(channel, unit)
    values = {}
    for name, quantity, si in (
        ("noise", sensor.noise, unit),
        ("step", sensor.step, unit),
        ("delay", sensor.delay, "s"),
    ):
        if quantity is not None:
            where = f"{path}: [sensors.{channel}] {name}"
            values[name] = quantity.parameter(name, si, where).value
            check_range(where, values[name], si, 0.0, float("inf"))
    return Sensor(channel, unit, **values)
