"""An identified plant as a TOML: its file with the changed numbers and structure; its linear set while sliding."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit

from ..core.errors import InputError
from ..core.files import FORCE_ARGUMENT, refuse_existing, write_text
from ..core.parameter import Parameter
from ..core.unit import factor
from ..plant.file import key_of
from ..plant.load import load_plant
from ..plant.plant import SENSOR_WORDS, Plant, Sensor


def plant_toml(plants: Sequence[Plant]) -> str:
    """The TOML of a plant with the numbers and structures of one or more of its models.

    Order, comments, units and everything that was not identified or set remain as in the file that the plants were
    loaded from. A number that both models share is written to the model that identified it, so that the other one
    keeps its value. Symbols of effects and friction laws that the file lacks are added to the model that has them;
    symbols that a model no longer has are removed. A sensor's number has the provenance of the entry of
    `Sensor.stated` with its name ("p1 bias").

    Parameters
    ----------
    plants: models of one file, with changed values, friction laws, chamber form, effects or sensors.

    Raises InputError for plants without a file, or from different files.
    """
    paths = {plant.path for plant in plants}
    path = next(iter(paths), None)
    if len(paths) != 1 or path is None:
        raise InputError("the plants to be written must come from one TOML file; load them with load_plant")
    document: Any = tomlkit.parse(path.read_text(encoding="utf-8"))
    for plant in plants:
        before = load_plant(path, model=plant.model)
        _put_structure(document, before, plant)
        for name, parameter in plant.parameters.items():
            old = before.parameters.get(name)
            if old is not None and _stated(old) == _stated(parameter):
                continue
            own = parameter.source in ("identified", "derived") or name in document[plant.model]["parameters"]
            if key_of(name) != name:
                _put(_table(document, "load"), key_of(name).removeprefix("load."), parameter)
            elif not own and name in document.get("parameters", {}):
                _put(_table(document, "parameters"), name, parameter)
            else:
                _put(_table(document, plant.model, "parameters"), name, parameter)
        for channel, sensor in plant.sensors.items():
            for word in SENSOR_WORDS:
                if getattr(sensor, word) != getattr(before.sensors[channel], word):
                    _put(_table(document, "sensors", channel), word, _sensor_number(sensor, word))
    return str(tomlkit.dumps(document))


def write_plant(path: str | Path, *plants: Plant, force: bool = False) -> Path:
    """Write `plant_toml` to a file and return its path.

    force: replace an existing file. Raises InputError as `plant_toml`, for an existing file without `force`, and for a
    path that can't be written.
    """
    refuse_existing(Path(path), force=force, how=FORCE_ARGUMENT)
    return write_text(path, plant_toml(plants))


def _stated(parameter: Parameter) -> tuple[float, str, float | None, float | None]:
    return parameter.value, parameter.source, parameter.sd, parameter.spread


def _put_structure(document: Any, before: Plant, plant: Plant) -> None:
    """Write the changed entries of a model's structure, and remove the symbols that it no longer has."""
    table, old, new = document[plant.model], before.structure, plant.structure
    for word in ("shaft_friction", "rod_friction", "chambers"):
        if getattr(new, word) != getattr(old, word):
            table[word] = getattr(new, word)
    if new.effects != old.effects:
        table["effects"] = list(new.effects)
    if not new.effects:
        table.pop("effects", None)
    for name in before.parameters:
        if name in plant.parameters:
            continue
        shared = document.get("parameters", {})
        if name in shared:
            # The other model may need it.
            entry = shared.pop(name)
            other = {"linear": "nonlinear", "nonlinear": "linear"}[plant.model]
            if other in document and name not in document[other]["parameters"]:
                document[other]["parameters"][name] = entry
        table["parameters"].pop(name, None)
    free = [name for name in plant.free if name in plant.parameters]
    if "free" in table and [*table["free"]] != free:
        table["free"] = free


def _sensor_number(sensor: Sensor, word: str) -> Parameter:
    """One number of a sensor, with its stated provenance if it has one."""
    value = getattr(sensor, word)
    for stated in sensor.stated:
        if stated.name == f"{sensor.channel} {word}" and stated.value == value:
            return stated
    return Parameter(word, value, sensor.unit_of(word), "identified", note="as identified or set")


def _table(document: Any, *keys: str) -> Any:
    """The table at `keys`, created if it is missing."""
    table = document
    for key in keys:
        if key not in table:
            table[key] = tomlkit.table()
        table = table[key]
    return table


def _put(table: Any, key: str, parameter: Parameter) -> None:
    """Write one number in the unit that the file uses for it."""
    old = table.get(key)
    unit = str(old["unit"]) if old is not None else parameter.unit
    scale = factor(unit, parameter.unit)
    entry = tomlkit.inline_table()
    entry["value"] = _rounded(parameter.value / scale, None if parameter.sd is None else parameter.sd / scale)
    entry["unit"] = unit
    if parameter.sd is not None and math.isfinite(parameter.sd):
        entry["sd"] = float(f"{parameter.sd / scale:.3g}")
    if parameter.spread is not None:
        entry["spread"] = float(f"{parameter.spread / scale:.3g}")
    lower, upper = parameter.lower / scale, parameter.upper / scale
    if math.isfinite(lower) and math.isfinite(upper) and lower <= entry["value"] <= upper:
        entry["bounds"] = [float(f"{lower:.6g}"), float(f"{upper:.6g}")]
    entry["source"] = "assumed" if parameter.source == "given" else parameter.source
    note = "set for an identification" if parameter.source == "given" else parameter.note
    if note:
        entry["note"] = note
    # A new key goes behind the last one, not behind comments that may belong to the next table.
    body = table.value.body if old is None and isinstance(table, tomlkit.items.Table) else []
    behind = len(body)
    while behind > 0 and body[behind - 1][0] is None:
        behind -= 1
    comments = body[behind:]
    del body[behind:]
    table[key] = entry
    body += comments


def _rounded(value: float, sd: float | None) -> float:
    """A value with digits down to a thousandth of its deviation, at least six; infinity ("never") is unchanged."""
    digits = 6
    if not math.isfinite(value):
        return value
    if sd is not None and math.isfinite(sd) and sd > 0.0 and value != 0.0:
        digits = max(digits, math.ceil(math.log10(abs(value) / sd)) + 3)
    return float(f"{value:.{min(digits, 15)}g}")


def sliding_linear(plant: Plant) -> Plant:
    """The linear model of the same file, with the numbers that it shares with a nonlinear `plant`.

    A linear model fitted to a rig with dry friction has too much damping, and a controller designed on it is too
    aggressive while the rig slides. Viscous friction, inertia, mass, volumes and leakage of the nonlinear set give the
    linear model that is valid during sliding. V is the mean of V_10 and V_20. Changed values are marked as derived.

    Raises InputError for a plant without a file, or whose file has no linear model.
    """
    if plant.path is None or plant.model != "nonlinear":
        raise InputError("a linear set is derived from a plant's nonlinear model, loaded from a file with load_plant")
    linear = load_plant(plant.path, model="linear")
    shared = {name: plant.parameters[name] for name in linear.parameters if name in plant.parameters}
    if {"V_10", "V_20"} <= set(plant.parameters) and "V" in linear.parameters:
        mean = 0.5 * (plant["V_10"] + plant["V_20"])
        shared["V"] = Parameter("V", mean, "m3", plant.parameters["V_10"].source)
    changed = dict(linear.parameters)
    for name, parameter in shared.items():
        old = linear.parameters[name]
        if parameter.value == old.value:
            continue
        source = "derived" if parameter.source == "identified" else parameter.source
        note = "the nonlinear set's, while it slides" if source == "derived" else parameter.note
        changed[name] = replace(old, value=parameter.value, source=source, sd=None, note=note, written="")
    return replace(linear, parameters=changed)
