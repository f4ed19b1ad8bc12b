"""Provenance of a result: assumed parameters with their ranges, and hashes of the input files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..core.parameter import Parameter
from ..core.unit import factor
from ..plant.plant import Plant
from .text import number, quantity_in


def provenance(plants: Iterable[Plant], files: Iterable[str | Path | None] = ()) -> dict[str, Any]:
    """Content of `rests_on` in a result's JSON: assumed parameters in the units of the plant's file, hashes of files.

    files: input files besides those of the plants; None and paths without a file are omitted.
    """
    given = list(plants)
    return {"assumed": assumed_rows(given), "files": dict(hashes([*files, *(plant.path for plant in given)]))}


def hashes(files: Iterable[str | Path | None]) -> list[tuple[str, str]]:
    """Name and first 16 digits of the SHA-256 of each existing file, without repetition."""
    found: dict[str, str] = {}
    for file in files:
        if file is not None and Path(file).is_file():
            found[str(file)] = hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]
    return list(found.items())


def assumed_rows(plants: Iterable[Plant]) -> list[dict[str, str]]:
    """Assumed parameters, limits and sensor data of the plants, without repetition, in the units of the file."""
    found: dict[tuple[str, str, float], dict[str, str]] = {}
    for plant in plants:
        sensors = [number for sensor in plant.sensors.values() for number in sensor.stated]
        for parameter in (*plant.parameters.values(), *plant.limits.values(), *sensors):
            if parameter.source == "assumed":
                row = {"plant": plant.name, "name": parameter.name, **_texts(parameter), "note": parameter.note}
                found.setdefault((plant.name, parameter.name, parameter.value), row)
    return list(found.values())


def _texts(parameter: Parameter) -> dict[str, str]:
    """Value and range as text."""
    own = parameter.file_unit
    value, high = (quantity_in(each, own, parameter.unit) for each in (parameter.value, parameter.upper))
    if parameter.lower == -float("inf") and parameter.upper == float("inf"):
        return {"value": value, "range": ""}
    return {"value": value, "range": f"{number(parameter.lower / factor(own, parameter.unit))} to {high}"}


def merged_versions(provenances: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Software versions of several results; differing versions are listed together."""
    found: dict[str, set[str]] = {}
    for versions in provenances:
        for name, version in versions.items():
            found.setdefault(name, set()).add(version)
    return {name: ", ".join(sorted(versions)) for name, versions in found.items()}
