"""Tables of a log: columns with the names, units and times of the file; errors name file, column and row."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas

from .errors import InputError


@dataclass(frozen=True)
class FileTime:
    """Time that a file gives the rows of a table beside its columns.

    values: (N,) s. source: what gave it, as in "wf_increment". step: the sample time that the file states [s], 0 if it
    has a stamp for each row. start: the date of value 0 [s since 1970, UTC], None if the file does not give it.
    """

    values: np.ndarray
    source: str
    step: float = 0.0
    start: float | None = None


@dataclass(frozen=True)
class LogTable:
    """Columns of a file that were sampled together, before they are matched to channels.

    lines: number of each row for messages (in a CSV that of the line, from 1).
    text: (column, row number) -> text of the cell. decimal: decimal mark.
    units: column -> unit. units_row: number of the row of units in a text file, else 0.
    notes: sentences on what was assumed in reading.
    group: name of the table in its file (a group, topic or dataset); empty for a file that is one table.
    time: as the file gives it; None if time is a column.
    """

    path: Path
    frame: pandas.DataFrame
    lines: np.ndarray
    text: Callable[[str, int], str]
    decimal: str = "."
    units: Mapping[str, str] = field(default_factory=dict)
    units_row: int = 0
    notes: tuple[str, ...] = ()
    group: str = ""
    time: FileTime | None = None

    @property
    def names(self) -> list[str]:
        return [str(name) for name in self.frame.columns]

    def __len__(self) -> int:
        return len(self.frame)

    def find(self, column: str) -> str:
        """The name of this column in this table, also for group/column; empty if the table lacks it."""
        if column in self.names:
            return column
        inside = column.removeprefix(f"{self.group}/") if self.group else column
        return inside if inside != column and inside in self.names else ""

    def joined(self, other: LogTable, column: str) -> LogTable:
        """This table with a column of another one that has as many rows."""
        frame = self.frame.assign(**{column: other.frame[column].to_numpy()})
        units = {**self.units, **({column: other.units[column]} if column in other.units else {})}
        return replace(self, frame=frame, units=units)

    def rows(self, kept: np.ndarray) -> LogTable:
        """The rows where `kept` (N,) is true."""
        time = None if self.time is None else replace(self.time, values=self.time.values[kept])
        return replace(self, frame=self.frame[kept].reset_index(drop=True), lines=self.lines[kept], time=time)

    def numbered(self, first: int) -> LogTable:
        """The same table, with rows that messages count from `first`."""
        text, shift = self.text, first - 1
        return replace(self, lines=self.lines + shift, text=lambda column, row: text(column, row - shift))

    def numbers(self, column: str) -> np.ndarray:
        """A column (N,) of finite numbers. Raises InputError with column and row of the first cell that is not one."""
        series = self.frame[column]
        if series.dtype.kind in "mM":
            raise InputError(f"{self.path}: column {column!r} contains dates or durations; expected plain numbers")
        values = pandas.to_numeric(series, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise self.no_number(column, int(bad[0]))
        return values

    def no_number(self, column: str, index: int) -> InputError:
        """The error for a cell that is not a finite number; `index` counts the rows from 0."""
        row = int(self.lines[index])
        text = self.text(column, row)
        if not text:
            return InputError(f"{self.path}: column {column!r}, row {row}: the cell is empty; every row needs a number")
        comma = self.decimal == "." and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", text)
        remedy = "correct it, or use a part of the log without it"
        if comma:
            remedy = f"write decimals with a point, {text.strip().replace(',', '.')}"
        return InputError(f"{self.path}: column {column!r}, row {row}: {text!r} is not a finite number; {remedy}")


def table_from_pandas(frame: pandas.DataFrame, *, time: str = "") -> LogTable:
    """A table in memory. A named index becomes a column; an unnamed one becomes the column `time` if there is no such
    column and the index is more than row numbers."""
    if frame.index.name is not None:
        frame = frame.reset_index()
    elif time and time not in frame.columns and not isinstance(frame.index, pandas.RangeIndex):
        frame = frame.rename_axis(time).reset_index()
    return table_of(Path("the table"), frame)


def table_of(
    path: Path,
    columns: pandas.DataFrame | Mapping[str, np.ndarray],
    *,
    units: Mapping[str, str] | None = None,
    group: str = "",
    time: FileTime | None = None,
) -> LogTable:
    """A table of columns (N,) by name; rows count from 1 in messages. Arguments as the attributes of LogTable."""
    frame = columns if isinstance(columns, pandas.DataFrame) else pandas.DataFrame(dict(columns))

    def cell_text(column: str, row: int) -> str:
        value = frame[column].iloc[row - 1]
        return "" if value is None else str(value)

    known = {name: unit.strip() for name, unit in (units or {}).items() if unit.strip() not in ("", "-", "--")}
    return LogTable(path, frame, np.arange(1, len(frame) + 1), cell_text, units=known, group=group, time=time)


def number_columns(name: str, values: Any) -> dict[str, np.ndarray]:
    """Columns by name from numbers or dates of one quantity: (N,), (N, 1) or (1, N); name[0], ... for (N, k).

    Empty for anything else, such as text, a single number or an array of more axes.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiubM" or array.ndim not in (1, 2) or array.size < 2:
        return {}
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    if array.ndim == 1:
        return {name: array}
    return {f"{name}[{k}]": array[:, k] for k in range(array.shape[1])} if array.shape[1] < array.shape[0] else {}
