"""HDF5, read with h5py: datasets of numbers in any groups, one of whose datasets may be the time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..table import FileTime, LogTable, number_columns, table_of
from ._format import Format

#: Attributes of a dataset or group that state its unit, sample time [s] or rate [Hz].
UNITS = ("unit", "units", "Unit", "Units")
STEPS = ("dt", "sample_time", "Ts", "wf_increment")
RATES = ("fs", "sample_rate", "sampling_rate", "sampling_frequency", "rate")


def _read(path: Path) -> list[LogTable]:
    import h5py

    tables = []
    with h5py.File(path, "r") as file:
        groups: list[Any] = [file]
        file.visititems(lambda name, item: groups.append(item) if isinstance(item, h5py.Group) else None)
        for group in groups:
            together: dict[tuple[int, float], tuple[dict[str, np.ndarray], dict[str, str]]] = {}
            for name, item in group.items():
                if not isinstance(item, h5py.Dataset):
                    continue
                for column, values in _columns(name, item).items():
                    columns, units = together.setdefault((len(values), _step(item, group, file)), ({}, {}))
                    columns[column] = values
                    units[column] = next((_word(item.attrs[key]) for key in UNITS if key in item.attrs), "")
            for (count, step), (columns, units) in together.items():
                time = FileTime(step * np.arange(count), "the attribute of its sample time", step) if step else None
                tables.append(table_of(path, columns, units=units, group=group.name.strip("/"), time=time))
    return tables


def _columns(name: str, item: Any) -> dict[str, np.ndarray]:
    """Columns of a dataset; those of a dataset of records by the names of its fields."""
    if item.dtype.names and item.ndim == 1:
        records = item[()]
        return {
            field: values for field in item.dtype.names for values in number_columns(field, records[field]).values()
        }
    return number_columns(name, item[()]) if item.ndim in (1, 2) and item.dtype.kind in "fiub" else {}


def _step(*places: Any) -> float:
    """The stated sample time [s] of the first place that states one; else 0."""
    for place in places:
        for keys, power in ((STEPS, 1), (RATES, -1)):
            for key in keys:
                stated = np.asarray(place.attrs.get(key, 0.0))
                if stated.dtype.kind in "fiu" and stated.size == 1 and float(stated.ravel()[0]) > 0.0:
                    return float(stated.ravel()[0]) ** power
    return 0.0


def _word(text: Any) -> str:
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)


format = Format(
    name="HDF5",
    suffixes=(".h5", ".hdf5", ".hdf"),
    contents="datasets (also of records) in all groups; time in a dataset, or from an attribute `dt` or `fs`; units "
    "from the attribute `unit`",
    read=_read,
    modules=("h5py",),
    extra="hdf5",
    magic=(b"\x89HDF\r\n\x1a\n",),
)
