"""Read measured logs from files: columns become channels in SI units on a uniform time grid."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .clock import row_time
from .column_matching import channel_scale, column_names, find_channels, suggest_mapping
from .errors import MOST, InputError, choices
from .formats import read_tables
from .log import CHANNELS, TIME_TOLERANCE, Column, Log, check_time
from .table import LogTable
from .text import join_words


class ReadingOptions(NamedTuple):
    """How to read a log; the default reads one with a uniform time of its own.

    shortest: least number of rows.
    uniform: False also accepts jitter, but no gap of more than LONGEST_STEP median steps.
    wanted: further channels for which notes suggest a mapping.
    span: rows outside these times [s] are ignored.
    sample_time: of the rows [s], instead of any time in the file.
    rate: to which a log of several rates is resampled [Hz]; None makes such a log an error.
    held: channels that are constant between their samples, such as the command of a drive.
    """

    shortest: int = 2
    uniform: bool = True
    wanted: Sequence[str] = ()
    span: tuple[float | None, float | None] = (None, None)
    sample_time: float | None = None
    rate: float | None = None
    held: Collection[str] = ()


PLAIN = ReadingOptions()


def read_log(
    path: str | Path,
    required: Sequence[str],
    *,
    columns: Mapping[str, Column] | None = None,
    shortest: int = 2,
    uniform: bool = True,
    wanted: Sequence[str] = (),
    span: tuple[float | None, float | None] = (None, None),
    sample_time: float | None = None,
    rate: float | None = None,
    held: Collection[str] = (),
) -> Log:
    """Read a uniformly sampled log in any of the FORMATS; the content of the file decides, else its ending.

    A CSV may be separated by commas, semicolons, tabs or blanks, have decimal points or commas, comment rows (# or %)
    and a row of units below its header, and be in UTF-8, UTF-16 or Latin-1; `notes` of the log report what was assumed.
    An ambiguous file is an error. Columns to which the file gives a unit are converted to SI units unless their
    mapping gives a scale. Dates and stamps since an epoch are counted from the first row.

    Parameters
    ----------
    required: channels that must exist; other CHANNELS are read if they exist.
    columns: channel -> column of the file, also for "t"; group/column where several groups have the column. Other
        channels are found by their own names, as is every channel of a file that has none of these columns.
    shortest, uniform, wanted, span, sample_time, rate, held: see ReadingOptions.

    Raises
    ------
    InputError: no such file, a missing library, not a file of its format or a damaged one, an ambiguous CSV, a missing
        or ambiguous column, a value that is not a finite number, a unit that is unknown or contradicts the mapping,
        time that does not advance or has a gap, several rates without `rate`, fewer than `shortest` rows. One sentence
        with file, column and row (the first line of a CSV is row 1, so is the first sample elsewhere).
    """
    path = Path(path)
    how = ReadingOptions(shortest, uniform, wanted, span, sample_time, rate, held)
    log = log_from_tables(path, read_tables(path), required, columns, how)
    return replace(log, path=path)


class Part(NamedTuple):
    """The channels that were sampled together: time (N,) s, channel -> values (N,), and the date of time 0 (s since
    1970). notes: sentences on what was assumed. converted: channel -> the unit in the file, where it was converted.
    source: what gave the time, empty for a column."""

    time: np.ndarray
    channels: dict[str, np.ndarray]
    start: float | None
    notes: tuple[str, ...]
    converted: dict[str, str]
    source: str


def log_from_tables(
    path: Path | str,
    tables: Sequence[LogTable],
    required: Sequence[str],
    columns: Mapping[str, Column] | None,
    how: ReadingOptions = PLAIN,
) -> Log:
    """A log from the tables of a file; arguments and errors as in `read_log`."""
    columns = dict(columns or {})
    places = find_channels(path, tables, columns)
    lines = suggest_mapping(tables, places, ("t", *required, *how.wanted))
    place = "under [log] in the plant's TOML (ehsa-ctrl new plant NAME writes one of your own)"
    write = f"check units and signs, then write {lines} {place}" if lines else ""
    names = column_names(tables)
    clockless = how.sample_time is None and not all(table.time or "t" in at for table, at in places)
    found = {channel for _, at in places for channel in at}
    for channel in ("t",) * clockless + tuple(required):
        if channel not in found or (channel == "t" and clockless):
            column = columns.get(channel, Column(channel)).column
            why = "" if column == channel else f", where the plant's [log] looks for {channel}"
            hint = f"; {write}" if write else ""
            if channel == "t" and "t = " not in lines:
                hint += "; or give the sample time of the rows (--sample-time)"
            raise InputError(f"{path}: has no column {column!r}{why}; {choices(column, names)}{hint}")
    if not found - {"t"}:
        hint = f"; {write}" if write else ""
        raise InputError(
            f"{path}: has none of the channels {', '.join(c for c in CHANNELS if c != 't')}; map its columns in the "
            f"plant's [log] table: {', '.join(names[:MOST])}{hint}"
        )
    parts = [_part(path, table, at, how, len(places) > 1) for table, at in places]
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    converted = [f"{channel} from {unit}" for part in parts for channel, unit in part.converted.items()]
    if converted:
        source = "row of units" if any(table.units_row for table, _ in places) else "units"
        notes.append(f"{path}: converted by its {source}: {', '.join(converted)}")
    log = _joined(path, parts, how)
    for channel, at in columns.items():
        if channel in how.wanted and channel not in log.channels:
            near = choices(at.column, names)
            notes.append(f"{path}: has no column {at.column!r}, where the plant's [log] looks for {channel}; {near}")
    if write:
        notes.append(f"{path}: has unread columns that look like channels; {write}")
    dates = [part.start for part in parts if part.start is not None]
    return replace(log, notes=(*notes, *log.notes), start=min(dates, default=None))


def _part(path: Path | str, table: LogTable, at: Mapping[str, Column], how: ReadingOptions, several: bool) -> Part:
    """The channels of one table in SI units. several: the log has other tables, too."""
    scales = {channel: channel_scale(path, channel, where, table) for channel, where in at.items()}
    clock = row_time(table, at.get("t"), scales.get("t", 1.0), how.sample_time)
    time = clock.values
    if how.span != (None, None):
        first, last = (
            limit if limit is not None else end for limit, end in zip(how.span, (-np.inf, np.inf), strict=True)
        )
        kept = (time >= first) & (time <= last)
        table, time = table.rows(kept), time[kept]
    where = f" in {table.group!r}" if several else ""
    if len(table) < (2 if several else how.shortest):
        raise InputError(
            f"{path}: has {len(table)} rows of data{where}; expected at least {2 if several else how.shortest}"
        )
    if not np.all(np.isfinite(time)):
        bad = int(np.flatnonzero(~np.isfinite(time))[0])
        column = at["t"].column if "t" in at else ""
        if column:
            raise table.no_number(column, bad)
        raise InputError(f"{path}: row {int(table.lines[bad])}{where} has no time ({table.time and table.time.source})")
    values = {
        channel: scales[channel] * table.numbers(place.column) + place.offset
        for channel, place in at.items()
        if channel != "t"
    }
    what = (
        f"column {at['t'].column!r}" if "t" in at and how.sample_time is None else f"the time{where or ' of its rows'}"
    )
    check_time(path, time, uniform=how.uniform and not several, lines=table.lines, what=what)
    converted = {c: table.units[place.column] for c, place in at.items() if scales[c] != place.scale}
    source = "the given sample time" if how.sample_time is not None else ""
    if not source and "t" not in at and table.time is not None:
        source = table.time.source
    return Part(time, values, clock.start, (*table.notes, *clock.notes), converted, source)


def _joined(path: Path | str, parts: Sequence[Part], how: ReadingOptions) -> Log:
    """The log of all parts: as it is for one, on the common samples for equal times, else resampled."""
    if len(parts) == 1:
        return Log(parts[0].time, parts[0].channels, time_source=parts[0].source)
    if how.sample_time is not None and len({part.time.size for part in parts}) > 1:
        sizes = ", ".join(f"{join_words(part.channels)} {part.time.size}" for part in parts)
        raise InputError(
            f"{path}: its groups have different numbers of samples ({sizes}), so that one sample time can't hold for "
            "all; leave it out, or map channels of one group only"
        )
    starts = [part.start for part in parts]
    known = [start for start in starts if start is not None]
    notes = []
    if known and len(known) < len(parts):
        notes.append(f"{path}: only some of its groups have dates; all are taken to begin together")
    dated = len(known) == len(parts)
    times = [part.time + (start - min(known) if dated and start is not None else 0.0)
             for part, start in zip(parts, starts, strict=True)]  # fmt: skip
    first, last = max(time[0] for time in times), min(time[-1] for time in times)
    if not first < last:
        spans = join_words(
            [
                f"{join_words(part.channels)} from {time[0]:g} to {time[-1]:g} s"
                for part, time in zip(parts, times, strict=True)
            ]
        )
        raise InputError(f"{path}: its groups were not recorded at the same time: {spans}")
    step = float(np.median(np.diff(times[0])))
    slack = TIME_TOLERANCE * step
    within = [(time >= first - slack) & (time <= last + slack) for time in times]
    common = [time[inside] for time, inside in zip(times, within, strict=True)]
    if all(time.size == common[0].size and np.allclose(time, common[0], rtol=0, atol=slack) for time in common):
        if common[0].size < how.shortest:
            raise InputError(f"{path}: has {common[0].size} common rows of data; expected at least {how.shortest}")
        if how.uniform:
            check_time(path, common[0], first_row=1)
        channels = {
            name: values[inside] for part, inside in zip(parts, within, strict=True)
            for name, values in part.channels.items()
        }  # fmt: skip
        return Log(common[0], channels, notes=tuple(notes), time_source=parts[0].source)
    return _resampled(path, parts, times, how, notes)


def _resampled(
    path: Path | str, parts: Sequence[Part], times: Sequence[np.ndarray], how: ReadingOptions, notes: list[str]
) -> Log:
    from .resampling import Sampled, merge

    rates = ", ".join(
        f"{join_words(part.channels)} at {1.0 / np.median(np.diff(time)):.5g} Hz"
        for part, time in zip(parts, times, strict=True)
    )
    if how.rate is None:
        raise InputError(f"{path}: has several rates ({rates}); give the rate to which it is resampled (--resample HZ)")
    signals = {
        name: Sampled(time, values) for part, time in zip(parts, times, strict=True)
        for name, values in part.channels.items()
    }  # fmt: skip
    merged = merge(signals, how.rate, how.held)
    if merged.time.size < how.shortest:
        raise InputError(
            f"{path}: has several rates ({rates}), of which {merged.time.size} samples are left at {how.rate:g} Hz; "
            f"expected at least {how.shortest}"
        )
    return Log(merged.time, merged.channels, notes=(*notes,), rates=merged.change)
