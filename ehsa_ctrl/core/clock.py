"""Time of the rows of a table in seconds: from dates, stamps since an epoch, relative stamps or a sample time."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
import pandas

from .errors import InputError
from .log import Column
from .table import LogTable


@dataclass(frozen=True)
class RowTime:
    """Time of the rows of one table.

    values: (N,) s; NaN where a cell holds no time. start: the date of value 0 [s since 1970, UTC], None if unknown.
    notes: sentences on what was assumed.
    """

    values: np.ndarray
    start: float | None = None
    notes: tuple[str, ...] = ()


class Epoch(NamedTuple):
    """Stamps that count from a date: their name, seconds per count, and the count at 1970-01-01 (UTC)."""

    name: str
    tick: float
    zero: float


#: Epochs and units whose counts of this century can't be confused. Excel counts days from 1899-12-30, MATLAB's datenum
#: from year 0, Windows' FILETIME 100 ns from 1601, LabVIEW seconds from 1904.
EPOCHS = (
    Epoch("s since 1970", 1.0, 0.0),
    Epoch("ms since 1970", 1e-3, 0.0),
    Epoch("us since 1970", 1e-6, 0.0),
    Epoch("ns since 1970", 1e-9, 0.0),
    Epoch("100 ns since 1601 (FILETIME)", 1e-7, 116_444_736_000_000_000.0),
    Epoch("days of Excel", 86400.0, 25569.0),
    Epoch("days of MATLAB's datenum", 86400.0, 719529.0),
    Epoch("s since 1904 (LabVIEW)", 1.0, 2_082_844_800.0),
)
#: Dates that a log may have [s since 1970]: the years 2000 to 2064. Later seconds since 1970 are LabVIEW's of 2000.
FIRST, LAST = 946_684_800.0, 3.0e9
#: Sample times that a log with such stamps may have [s]; they tell its unit from a counter with the same values.
SHORTEST_STEP, LONGEST_STEP = 1e-7, 0.5
#: Stated and stamped sample times that differ by more than this share contradict each other. Engineering judgement.
DIFFERENT = 0.01

_CLOCK = re.compile(r"\d{1,2}:\d{2}(:\d{2}(\.\d+)?)?")


def row_time(table: LogTable, at: Column | None, scale: float = 1.0, sample_time: float | None = None) -> RowTime:
    """Time of the rows: of a given sample time, else of the column `at` times `scale`, else as the file gives it.

    Dates and stamps since an epoch are counted from the first row. The offset of a column applies to relative stamps.

    Raises InputError for dates that are not ISO 8601, and for a table without any time.
    """
    where = f"{table.path}: column {at.column!r}" if at is not None else str(table.path)
    if sample_time is not None:
        given = RowTime(sample_time * np.arange(len(table)))
        stamped = None if at is None and table.time is None else row_time(table, at, scale)
        step = 0.0 if stamped is None else usual_step(stamped.values)
        if abs(step - sample_time) <= DIFFERENT * sample_time or not step > 0.0:
            return given
        return RowTime(
            given.values,
            notes=(f"{where}: its steps of {step:.6g} s are ignored for the given sample time of {sample_time:.6g} s",),
        )
    if at is None:
        if table.time is None:
            raise InputError(f"{where}: has no time")
        return RowTime(table.time.values, table.time.start)
    column = table.frame[at.column]
    dates = _dates(table, at, where) if column.dtype.kind not in "iufb" else None
    if dates is not None:
        found = dates
    else:
        numbers = pandas.to_numeric(column, errors="coerce")
        whole = isinstance(numbers.dtype, np.dtype) and numbers.dtype.kind in "iu"
        raw = numbers.to_numpy(dtype=np.int64) if whole else numbers.to_numpy(dtype=float, na_value=np.nan)
        found = _counts(raw, scale, at.offset, where)
    stated = 0.0 if table.time is None else table.time.step
    step = usual_step(found.values)
    if table.time is not None and stated > 0.0 and step > 0.0 and abs(step - stated) > DIFFERENT * stated:
        note = (
            f"{where}: its stamps are {step:.6g} s apart, but {table.time.source} says {stated:.6g} s; the stamps are "
            f"used: give --sample-time {stated:.6g} if they are wrong"
        )
        found = RowTime(found.values, found.start, (*found.notes, note))
    return found


def _counts(raw: np.ndarray, scale: float, offset: float, where: str) -> RowTime:
    """Time from numbers: stamps since an epoch are counted from the first, others are scale * number + offset."""
    first = raw[0] if raw.size else np.nan
    # Differences of whole numbers are exact, where stamps in ns as decimals are not.
    since = (raw - first).astype(float)
    epoch = _epoch(float(first), usual_step(since), scale)
    if epoch is None:
        return RowTime(scale * raw.astype(float) + offset)
    start = (float(first) - epoch.zero) * epoch.tick
    day = datetime.fromtimestamp(start, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    return RowTime(epoch.tick * since, start, (f"{where}: read as {epoch.name}, counted from {day}",))


def _epoch(first: float, step: float, scale: float) -> Epoch | None:
    """The epoch that these stamps count from; with a scale of the user's only one in its unit."""
    if not np.isfinite(first) or not step > 0.0:
        return None
    for epoch in EPOCHS:
        if scale != 1.0 and not np.isclose(scale, epoch.tick, rtol=1e-9):
            continue
        date = (first - epoch.zero) * epoch.tick
        if FIRST <= date <= LAST and SHORTEST_STEP <= step * epoch.tick <= LONGEST_STEP:
            return epoch
    return None


def _dates(table: LogTable, at: Column, where: str) -> RowTime | None:
    """Time from dates or times of day, counted from the first row; None if the cells are numbers as text."""
    column = table.frame[at.column]
    stamps: pandas.Series
    if column.dtype.kind in "mM":
        stamps = column
    else:
        text = column.astype(str).str.strip().str.replace(",", ".", regex=False)
        first = text.iloc[0] if len(text) else ""
        if _CLOCK.fullmatch(first):
            stamps = pandas.to_timedelta(text, errors="coerce")
        elif re.match(r"\d{4}-?\d{2}-?\d{2}[T ]", first):
            stamps = pandas.to_datetime(text, format="ISO8601", errors="coerce", utc=True)
        elif re.match(r"\d{1,4}[./-]\d{1,2}[./-]\d{1,4}", first):
            raise InputError(
                f"{where}, row {table.lines[0]}: the date {first!r} is not ISO 8601; write dates like "
                "2024-05-31T12:00:00.004, or a time in s"
            )
        else:
            return None
    if stamps.isna().all():
        return None
    origin = stamps[stamps.first_valid_index()]
    values = ((stamps - origin) / pandas.Timedelta(seconds=1)).to_numpy(dtype=float, na_value=np.nan)
    if stamps.dtype.kind == "m":
        return RowTime(values, notes=(f"{where}: read as times of day, counted from {origin}",))
    start = float(pandas.Timestamp(origin).timestamp())
    return RowTime(values, start, (f"{where}: read as dates, counted from {origin}",))


def usual_step(values: np.ndarray) -> float:
    """The usual step of stamps; 0 where there is none."""
    steps = np.diff(values[np.isfinite(values)])
    return float(np.median(steps)) if steps.size else 0.0
