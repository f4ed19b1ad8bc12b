"""Provenance of a result: assumed parameters with their ranges, hashes of the input files, and the date.

It names no machine and no user: a page may be sent to anybody.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..core.catalogue import is_shipped
from ..core.parameter import Parameter
from ..core.unit import factor
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .text import number, quantity_in


def provenance(plants: Iterable[Plant], files: Iterable[str | Path | None] = ()) -> dict[str, Any]:
    """Content of `rests_on` in a result's JSON: assumed parameters in the units of the plant's file, hashes of files,
    date of the computation, and versions of the software.

    files: input files besides those of the plants; None and paths without a file are omitted.
    """
    given = list(plants)
    found = dict(hashes([*files, *(plant.path for plant in given)]))
    return {"assumed": assumed_rows(given), "files": found, "date": date(), "versions": versions()}


def date() -> str:
    """Now, in UTC to the minute. SOURCE_DATE_EPOCH [s] replaces the clock, for builds that must be reproducible."""
    stated = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(stated), UTC) if stated.isdigit() else datetime.now(UTC)
    return now.strftime("%Y-%m-%d %H:%M UTC")


def local_name(path: str | Path) -> str:
    """A path as it is told to others: relative to the current folder if it lies there, else its last two parts; a
    shipped definition by its folder and name.
    """
    path = Path(path)
    if not path.is_absolute():
        return str(path)
    if path.is_relative_to(Path.cwd()) and not is_shipped(path.parent.name, path):
        return str(path.relative_to(Path.cwd()))
    return str(Path(*path.parts[-2:]))


def hashes(files: Iterable[str | Path | None]) -> list[tuple[str, str]]:
    """Name and first 16 digits of the SHA-256 of each existing file, without repetition."""
    found: dict[str, str] = {}
    for file in files:
        if file is not None and Path(file).is_file():
            found[local_name(file)] = hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]
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
    for each in provenances:
        for name, version in each.items():
            found.setdefault(name, set()).add(version)
    return {name: ", ".join(sorted(versions)) for name, versions in found.items()}
