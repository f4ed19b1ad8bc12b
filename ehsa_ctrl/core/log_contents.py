"""What a file holds before anything is mapped: its groups with rate, span, columns and units."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .clock import row_time, usual_step
from .formats import format_of, read_tables
from .log import Column
from .table import LogTable


@dataclass(frozen=True)
class GroupContents:
    """One group of a file: its columns with their units, and its time.

    name: of the group, empty for a file that is one table. rows: number of samples.
    step: usual sample time [s]; None where it is unknown. span: [s].
    time: what gives the time: a column, or what the file has; empty where neither is found.
    """

    name: str
    rows: int
    columns: dict[str, str]
    step: float | None
    span: float | None
    time: str


@dataclass(frozen=True)
class LogContents:
    """The groups of a file of a format."""

    path: Path
    format: str
    groups: tuple[GroupContents, ...]

    def __str__(self) -> str:
        lines = [f"{self.path.name}: {self.format}, {len(self.groups)} group{'s' if len(self.groups) > 1 else ''}"]
        for group in self.groups:
            rate = f", {1.0 / group.step:.5g} Hz, {group.span:.5g} s" if group.step else ", without a time"
            source = f" by {group.time}" if group.time else ""
            lines.append(f"  {group.name or 'columns'}: {group.rows} samples{rate}{source}")
            lines += [f"    {name}" + (f" [{unit}]" if unit else "") for name, unit in group.columns.items()]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        return {"path": str(self.path), "format": self.format, "groups": [vars(group) for group in self.groups]}


def log_contents(path: str | Path, time: Column | None = None) -> LogContents:
    """Groups and columns of a file. time: the column with the time and its scale, by default `t`.

    Raises InputError as `read_tables`.
    """
    path = Path(path)
    at = Column("t") if time is None else time
    return LogContents(path, format_of(path).name, tuple(_group(table, at) for table in read_tables(path)))


def _group(table: LogTable, at: Column) -> GroupContents:
    column = table.find(at.column)
    step = span = None
    if column or table.time is not None:
        place = Column(column, at.scale, at.offset) if column else None
        values = row_time(table, place, at.scale).values
        finite = values[np.isfinite(values)]
        step = usual_step(values) or None
        span = float(finite[-1] - finite[0]) if finite.size else None
    source = f"column {column!r}" if column else table.time.source if table.time is not None else ""
    columns = {name: table.units.get(name, "") for name in table.names}
    return GroupContents(table.group, len(table), columns, step, span, source)
