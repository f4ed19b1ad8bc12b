"""Load plants from TOML files, and set parameters and sensors for one run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.catalogue import plants
from ..core.definition import read_definition
from ..core.errors import InputError, choices
from ..core.log import CHANNELS, Column
from ..core.parameter import Parameter, check_range
from ..core.registry import add_project
from ..core.unit import read_value
from ..core.watchdog import Watchdog
from .file import (
    LIMIT_STATES,
    LIMIT_UNITS,
    LOAD_SYMBOLS,
    ModelFile,
    PlantFile,
    Quantity,
    SensorFile,
    key_of,
    symbol_of,
)
from .plant import SENSOR_WORDS, Model, Plant, Sensor, effect_default
from .structure import Structure

#: Lower bounds of limits that may be negative [SI], and upper bound of all limits. Engineering judgement: far below the
#: least gauge pressure, -1.013e5 Pa, so that the limit can be switched off.
LEAST, MOST = {"pressure_min": -1e6}, 1e30


def load_plant(
    name: str | Path, *, model: Model = "nonlinear", settings: Mapping[str, str | float] | None = None
) -> Plant:
    """Load a plant by catalogue name or by the path of a TOML file.

    Parameters
    ----------
    name: e.g. "ehsa" or "my/rig.toml".
    model: parameter set of the plant, "linear" or "nonlinear".
    settings: values for one run, as on the command line: {"K_T": 1.1, "load.stiffness": "50 N/mm"}. Numbers and texts
        without a unit are in SI units.

    Raises InputError, with file and key, for a missing or invalid file or setting.
    """
    path = plants.find(name)
    add_project(path)
    file = read_definition(path, PlantFile)
    part: ModelFile | None = getattr(file, model, None)
    if part is None:
        known = [word for word in ("linear", "nonlinear") if getattr(file, word) is not None]
        if model == "linear" and known:
            raise InputError(f"{path}: has no [linear] model, on which controllers are designed, but only [{known[0]}]")
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
        log_controller=file.log_controller,
        watchdog=_watchdog(path, file, structure),
        sample_time=file.sampling.period.parameter("period", "s", f"{path}: [sampling] period").value,
        path=path,
    )
    check_range(f"{path}: [sampling] period.value", plant.sample_time, "s", 0.0, 1.0, lower_open=True)
    return with_settings(plant, settings or {})


def models_of(name: str | Path) -> tuple[Model, ...]:
    """The models ("linear", "nonlinear") of a plant's file. Raises InputError as load_plant does, and without any."""
    path = plants.find(name)
    file = read_definition(path, PlantFile)
    words: tuple[Model, ...] = ("linear", "nonlinear")
    found = tuple(word for word in words if getattr(file, word) is not None)
    if not found:
        raise InputError(f"{path}: has neither a [linear] nor a [nonlinear] model")
    return found


def with_settings(plant: Plant, settings: Mapping[str, str | float]) -> Plant:
    """The plant with settings for one run. Keys: symbols, load.WORD, and WORD.CHANNEL with SENSOR_WORDS.

    Raises InputError with the key.
    """
    sensors, symbols = dict(plant.sensors), {}
    for key, given in settings.items():
        if not is_sensor_setting(key):
            symbols[key] = given
            continue
        word, _, channel = key.partition(".")
        if channel not in sensors:
            raise InputError(f"{key}: {plant.name} has no sensor {channel!r}; {choices(channel, sensors)}")
        unit = sensors[channel].unit_of(word)
        try:
            changed: dict[str, Any] = {word: read_value(given, unit)}
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
        _check_sensor(key, word, changed[word], unit)
        sensors[channel] = replace(sensors[channel], **changed)
    return replace(plant, sensors=sensors).set(**read_settings(plant, symbols))


def is_sensor_setting(key: str) -> bool:
    """Whether a setting is one of a sensor, such as bias.p1 or delay.speed."""
    word, dot, _ = key.partition(".")
    return bool(dot) and word in SENSOR_WORDS


def has_setting(plant: Plant, key: str) -> bool:
    """Whether this model has a setting: each has sensors, but only the nonlinear one of the EHSA has A_FR."""
    return is_sensor_setting(key) or symbol_of(key) in plant.parameters


def read_settings(plant: Plant, settings: Mapping[str, str | float]) -> dict[str, float]:
    """Turn {"load.stiffness": "50 N/mm"} into {"K_S": 5e4}. Raises InputError with the key."""
    kinds = {kind.name: kind for kind in plant.structure.equations.parameters}
    values = {}
    for key, given in settings.items():
        symbol = symbol_of(key)
        if symbol not in kinds:
            known = choices(key, map(key_of, kinds))
            raise InputError(f"{key}: the {plant.model} model of {plant.name} has no such parameter; {known}")
        try:
            values[symbol] = read_value(given, kinds[symbol].unit)
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
    return values


def _parameters(path: Path, file: PlantFile, part: ModelFile, model: str, structure: Structure) -> dict[str, Parameter]:
    """Parameters of the structure, from the file or by default. Raises InputError for a missing or impossible one."""
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
            raise InputError(f"{where}: unknown parameter of {structure}; {choices(name, kinds)}")
        kind = kinds[name]
        parameter = quantity.parameter(name, kind.unit, where)
        check_range(where, parameter.value, kind.unit, kind.lower, kind.upper, lower_open=kind.lower_open)
        found[name] = parameter
    for name, kind in kinds.items():
        if name in found:
            continue
        default = effect_default(structure, name)
        if default is not None:
            found[name] = default
        elif kind.default is not None:
            found[name] = Parameter(name, kind.default, kind.unit, "assumed", note="not given")
        else:
            raise InputError(f"{path}: [{model}.parameters] {name} ({kind.meaning}, {kind.unit}) is missing")
    return {name: found[name] for name in kinds}


def _free(path: Path, file: PlantFile, part: ModelFile, model: str, structure: Structure) -> tuple[str, ...]:
    """Parameters that `identify` estimates by default, in the order of the equations."""
    known = structure.equations.parameter_names
    if part.free is None:
        written = {**file.parameters, **part.parameters}
        # Not estimated: infinite values, which switch something off, and the dead time, which has no derivative.
        identified = {name for name, q in written.items() if q.source == "identified" and math.isfinite(q.value)}
        return tuple(name for name in known if name in identified and name != structure.delay)
    for name in part.free:
        if name not in known:
            raise InputError(
                f"{path}: [{model}] free: {name!r} is not a parameter of this model; {choices(name, known)}"
            )
    return tuple(part.free)


def _limits(path: Path, file: PlantFile, structure: Structure) -> dict[str, Parameter]:
    limits = {}
    states = [state.name for state in structure.system.states]
    for name, quantity in file.limits.items():
        if name not in LIMIT_UNITS:
            raise InputError(f"{path}: [limits] {name}: unknown limit; {choices(name, LIMIT_UNITS)}")
        if LIMIT_STATES[name] not in states:
            raise InputError(f"{path}: [limits] {name}: does not apply to the system {file.system!r}; leave it out")
        where, unit = f"{path}: [limits] {name}", LIMIT_UNITS[name]
        limits[name] = quantity.parameter(name, unit, where)
        check_range(where, limits[name].value, unit, LEAST.get(name, 0.0), MOST, lower_open=name not in LEAST)
    return limits


def _watchdog(path: Path, file: PlantFile, structure: Structure) -> Watchdog:
    """The watchdog of a plant; its defaults where the file has none."""
    words = {"timeout": "s", "safe_current": structure.system.drive_unit}
    given = {word: getattr(file.watchdog, word) for word in words}
    values = {
        word: quantity.parameter(word, words[word], f"{path}: [watchdog] {word}").value
        for word, quantity in given.items()
        if quantity is not None
    }
    if "timeout" in values:
        check_range(f"{path}: [watchdog] timeout", values["timeout"], "s", 0.0, MOST, lower_open=True)
    return Watchdog.model_validate(values, context={"si": True})


def _log_columns(path: Path, file: PlantFile) -> dict[str, Column]:
    columns = {}
    for channel, at in file.log.items():
        if channel not in CHANNELS:
            raise InputError(f"{path}: [log] {channel}: unknown channel; {choices(channel, CHANNELS)}")
        try:
            columns[channel] = Column(at.column, at.scale, at.offset, "scale" in at.model_fields_set)
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
    unit = CHANNELS[channel].unit
    if sensor is None:
        return Sensor(channel, unit)
    values: dict[str, float] = {}
    stated = []
    units = {"noise": unit, "step": unit, "filter": "s", "delay": "s", "scale": "1", "bias": unit}
    for name, si in units.items():
        quantity: Quantity | None = getattr(sensor, name)
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
