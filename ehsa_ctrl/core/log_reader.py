"""Read measured logs from files: columns become channels in SI units on a uniform time grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from .column_matching import channel_scale, find_channels, suggest_mapping
from .errors import InputError, choices
from .log import Column, Log, check_time
from .table import LogTable, read_table


def read_log(
    path: str | Path,
    required: Sequence[str],
    *,
    columns: Mapping[str, Column] | None = None,
    shortest: int = 2,
    uniform: bool = True,
    wanted: Sequence[str] = (),
    span: tuple[float | None, float | None] = (None, None),
) -> Log:
    """Read a uniformly sampled log from .csv (with header row), .parquet or .mat; the suffix decides.

    A CSV may be separated by commas, semicolons, tabs or blanks, have decimal points or commas, comment rows (# or %)
    and a row of units below its header, and be in UTF-8, UTF-16 or Latin-1; `notes` of the log report what was assumed.
    An ambiguous file is an error. Columns with a unit in the row of units are converted to SI units unless their
    mapping gives a scale.

    Parameters
    ----------
    required: channels that must exist; other CHANNELS are read if they exist.
    columns: channel -> column of the file, also for "t". Other channels are found by their own names, as is every
        channel of a file that has none of these columns.
    shortest: least number of rows.
    uniform: False also accepts jitter, but no gap of more than LONGEST_STEP median steps.
    wanted: further channels for which notes suggest a mapping.
    span: rows outside these times [s] are ignored.

    Raises
    ------
    InputError: no such file, not a table, an ambiguous CSV, a missing column, a value that is not a finite number, a
        unit that is unknown or contradicts the mapping, time that does not advance or has a gap, fewer than `shortest`
        rows. One sentence with file, column and row (the first line of a CSV is row 1).
    """
    path = Path(path)
    log = log_from_table(path, read_table(path), required, columns, shortest, uniform, wanted, span)
    return replace(log, path=path)


def log_from_table(
    path: Path | str,
    table: LogTable,
    required: Sequence[str],
    columns: Mapping[str, Column] | None,
    shortest: int = 2,
    uniform: bool = True,
    wanted: Sequence[str] = (),
    span: tuple[float | None, float | None] = (None, None),
) -> Log:
    """A log from the columns of a table; arguments and errors as in `read_log`."""
    places = find_channels(table, dict(columns or {}))
    lines = suggest_mapping(table, places, ("t", *required, *wanted))
    write = f"check units and signs, then write {lines} under [log] in the plant's TOML" if lines else ""
    for channel in ("t", *required):
        if channel not in places:
            column = (columns or {}).get(channel, Column(channel)).column
            why = "" if column == channel else f", where the plant's [log] looks for {channel}"
            hint = f"; {write}" if write else ""
            raise InputError(f"{path}: has no column {column!r}{why}; {choices(column, table.names)}{hint}")
    if span != (None, None):
        at = places["t"]
        table = table.within(at.column, channel_scale(path, "t", at, table), at.offset, span)
    if len(table.frame) < shortest:
        raise InputError(f"{path}: has {len(table.frame)} rows of data; expected at least {shortest}")
    scales = {channel: channel_scale(path, channel, at, table) for channel, at in places.items()}
    values = {channel: scales[channel] * table.numbers(at.column) + at.offset for channel, at in places.items()}
    time = values.pop("t")
    check_time(path, time, uniform=uniform, lines=table.lines)
    notes = list(table.notes)
    converted = [f"{c} from {table.units[at.column]}" for c, at in places.items() if scales[c] != at.scale]
    if converted:
        notes.append(f"{path}: converted by its row of units: {', '.join(converted)}")
    for channel, at in (columns or {}).items():
        if channel in wanted and channel not in places:
            near = choices(at.column, table.names)
            notes.append(f"{path}: has no column {at.column!r}, where the plant's [log] looks for {channel}; {near}")
    if write:
        notes.append(f"{path}: has unread columns that look like channels; {write}")
    return Log(time, values, notes=tuple(notes))
