"""MAT files: up to version 7 read with SciPy, 7.3 with pymatreader (HDF5)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..table import FileTime, LogTable, number_columns, table_of
from ._format import Format


def _read(path: Path) -> list[LogTable]:
    from scipy.io import loadmat

    return _tables(path, loadmat(path, simplify_cells=True))


def _read_73(path: Path) -> list[LogTable]:
    from pymatreader import read_mat

    return _tables(path, read_mat(path))


def _tables(path: Path, content: Mapping[str, Any]) -> list[LogTable]:
    """One table of all vectors; or one per structure of vectors, or of Simulink's structure with time."""
    content = {name: value for name, value in content.items() if not name.startswith(("__", "#"))}
    vectors = _vectors(content)
    structures = {name: value for name, value in content.items() if isinstance(value, Mapping)}
    if vectors:
        return [table_of(path, _equal(path, vectors))]
    tables = []
    for name, fields in structures.items():
        simulink = _with_time(path, name, fields)
        if simulink is not None:
            tables.append(simulink)
        elif columns := _vectors(fields):
            tables.append(table_of(path, _equal(path, columns), group=name))
    if not tables:
        raise InputError(
            f"{path}: expected one vector per channel, or structures of vectors, but it contains neither (timetables "
            "and timeseries are MATLAB objects: save their values as vectors)"
        )
    return tables


def _with_time(path: Path, name: str, fields: Mapping[str, Any]) -> LogTable | None:
    """Simulink's "structure with time": fields time and signals, each signal with label and values."""
    signals, time = fields.get("signals"), np.atleast_1d(fields.get("time", np.empty(0)))
    if isinstance(signals, Mapping):
        signals = [signals] if not isinstance(signals.get("values"), list) else _transposed(signals)
    if not isinstance(signals, list | np.ndarray) or time.dtype.kind not in "fiu" or time.size < 2:
        return None
    columns: dict[str, np.ndarray] = {}
    for number, signal in enumerate(signals):
        if isinstance(signal, Mapping) and "values" in signal:
            label = signal.get("label")
            given = label if isinstance(label, str) and label else name if len(signals) == 1 else f"{name}{number + 1}"
            columns |= number_columns(given, signal["values"])
    columns = {key: values for key, values in columns.items() if len(values) == time.size}
    return table_of(path, columns, group=name, time=FileTime(time.astype(float), f"{name}.time")) if columns else None


def _transposed(fields: Mapping[str, Any]) -> list[dict[str, Any]]:
    """An array of structures that was read as a structure of lists."""
    count = len(fields["values"])
    lists = {key: value for key, value in fields.items() if isinstance(value, list) and len(value) == count}
    return [{key: value[k] for key, value in lists.items()} for k in range(count)]


def _vectors(content: Mapping[str, Any]) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for name, value in content.items():
        columns = number_columns(name, value) if isinstance(value, np.ndarray) else {}
        if len(columns) == 1:  # a matrix is no channel
            found |= columns
    return found


def _equal(path: Path, vectors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    longest = max(len(vector) for vector in vectors.values())
    for name, vector in vectors.items():
        if len(vector) != longest:
            raise InputError(
                f"{path}: {name!r} has {len(vector)} values, but others have {longest}; all need the same length, or "
                "a structure for each rate, with its time"
            )
    return vectors


CONTENTS = "one vector per channel, one structure of vectors per rate, or Simulink's structure with time"

formats = (
    Format(name="MAT", suffixes=(".mat",), contents=CONTENTS, read=_read),
    Format(
        name="MAT 7.3",
        suffixes=(),
        contents="the same",
        read=_read_73,
        modules=("pymatreader", "h5py"),
        extra="mat73",
        magic=(b"MATLAB 7.3 MAT-file",),
    ),
)
