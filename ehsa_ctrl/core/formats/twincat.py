"""CSV of TwinCAT Scope: a block that describes the channels, then rows in which each group has its own time column.

The layout is that of exports of Scope 3.4 (the manual's page "Export in csv" lists its options): in each row of the
block, the row's own name is repeated in the column of each group's time; the channels of the group follow it.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pandas

from ..errors import InputError
from ..table import FileTime, LogTable, table_of
from ._format import Format

#: Ticks of a full time stamp (FILETIME: 100 ns since 1601) at 1970, and the length of a tick [s].
EPOCH, TICK = 116_444_736_000_000_000, 1e-7


def _is_scope(path: Path, head: bytes) -> bool:
    return head.lstrip(b"\xef\xbb\xbf").startswith(b"Name") and b"SampleTime" in head and b"Data-Type" in head


def _read(path: Path) -> list[LogTable]:
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")
    lines = text.splitlines()
    separator = lines[0][len("Name")] if len(lines[0]) > len("Name") else "\t"
    block = next((i for i, line in enumerate(lines) if i and line.startswith("Name" + separator)), 0)
    first = next((i for i in range(block, len(lines)) if re.match(r"\s*-?\d", lines[i])), 0)
    if not block or not first:
        raise InputError(f"{path}: is an export of TwinCAT Scope without channels or without rows; export it again")
    header = {row[0]: row for row in (line.split(separator) for line in lines[block:first]) if row[0]}
    names = header["Name"]
    body = [line for line in lines[first:] if line.strip() and not line.startswith("EOF")]
    # Point or comma: the separator is neither, and Scope writes no thousands separators.
    decimal = "," if any("," in line for line in body) and separator != "," else "."
    # Older versions end each row with a separator.
    width = max(len(names), *(line.count(separator) + 1 for line in body))
    cells = pandas.read_csv(
        io.StringIO("\n".join(body)), sep=separator, decimal=decimal, header=None, low_memory=False,
        names=range(width), index_col=False,
    )  # fmt: skip
    clocks = [i for i, name in enumerate(names) if name == "Name"]
    tables = []
    for clock, end in zip(clocks, [*clocks[1:], len(names)], strict=True):
        columns = [i for i in range(clock + 1, end) if names[i]]
        filled = np.flatnonzero(cells[clock].notna())
        if not columns or not filled.size:
            continue
        part = cells.iloc[: filled[-1] + 1]
        stamps = pandas.to_numeric(part[clock], errors="coerce").to_numpy()
        group = f"channels at {_steps(header, columns)} ms" if len(clocks) > 1 else ""
        table = table_of(
            path,
            {names[i]: part[i].to_numpy() for i in columns},
            units={names[i]: _unit(header, i) for i in columns},
            group=group,
            time=_time(stamps),
        )
        tables.append(table.numbered(first + 1))
    return tables


def _time(stamps: np.ndarray) -> FileTime:
    """Time of the rows from offsets in ms to the start of the export, or from full time stamps."""
    if stamps[0] > EPOCH:
        return FileTime((stamps - stamps[0]) * TICK, "full time stamps", start=float(stamps[0] - EPOCH) * TICK)
    return FileTime(stamps * 1e-3, "the group's time column in ms")


def _steps(header: dict[str, list[str]], columns: list[int]) -> str:
    row = header.get("SampleTime[ms]") or header.get("SampleTime") or []
    return row[columns[0]].replace(",", ".") if len(row) > columns[0] else "?"


def _unit(header: dict[str, list[str]], column: int) -> str:
    """The symbol of "V (Voltage)"; empty for "(None)"."""
    row = header.get("Unit", [])
    word = row[column].strip() if len(row) > column else ""
    return "" if word.startswith("(") else word.partition(" (")[0]


format = Format(
    name="TwinCAT Scope CSV",
    suffixes=(),
    contents="all channels with the time column of their group; units",
    read=_read,
    recognises=_is_scope,
)
