"""What a result rests on: parameters that were assumed, with their believed range, and the files it was made from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..core.parameter import Parameter
from ..core.unit import factor
from ..plant.plant import Plant
from .number import number, quantity

#: Plant, parameter or limit, its value and its believed range as written.
Assumed = tuple[str, Parameter, str, str]


def grounds(plants: Iterable[Plant], files: Iterable[str | Path | None] = ()) -> dict[str, Any]:
    """What a result's JSON says under `rests_on`: assumed parameters as written, and hashes of files.

    files: the plants' own are added; None and what is no file are left out.
    """
    given = list(plants)
    return {
        "assumed": [
            {"plant": plant, "name": parameter.name, "value": value, "range": range_, "note": parameter.note}
            for plant, parameter, value, range_ in assumed_of(given)
        ],
        "files": dict(hashes([*files, *(plant.path for plant in given)])),
    }


def hashes(files: Iterable[str | Path | None]) -> list[tuple[str, str]]:
    """Name and the first 16 digits of the SHA-256 of each file that is there, each once."""
    found: dict[str, str] = {}
    for file in files:
        if file is not None and Path(file).is_file():
            found[str(file)] = hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]
    return list(found.items())


def assumed_of(plants: Iterable[Plant]) -> list[Assumed]:
    """Everything that is assumed in some plants, each value once."""
    found: dict[tuple[str, str, float], Assumed] = {}
    for plant in plants:
        sensors = [number for sensor in plant.sensors.values() for number in sensor.stated]
        for parameter in (*plant.parameters.values(), *plant.limits.values(), *sensors):
            if parameter.source == "assumed":
                key = (plant.name, parameter.name, parameter.value)
                found.setdefault(key, (plant.name, parameter, *_written(parameter)))
    return list(found.values())


def written(parameter: Parameter, value: float) -> str:
    """A value of a parameter in the unit of the plant's file."""
    own = parameter.written.partition(" ")[2] or parameter.unit
    return quantity(value / factor(own, parameter.unit), own)


def _written(parameter: Parameter) -> tuple[str, str]:
    """Value and believed range in the unit of the plant's file."""
    value = written(parameter, parameter.value)
    if parameter.lower == -float("inf") and parameter.upper == float("inf"):
        return value, ""
    own = parameter.written.partition(" ")[2] or parameter.unit
    return value, f"{number(parameter.lower / factor(own, parameter.unit))} to {written(parameter, parameter.upper)}"
