"""A measured record: channels in SI units by name, from a CSV, Parquet or MAT file and back to CSV."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .errors import InputError, choices, shown
from .files import atomic_write
from .text import TextResult, unique_names

if TYPE_CHECKING:
    import pandas

    from .table import Table


class Channel(NamedTuple):
    """What a channel is measured in, and the decimals that its sensor is worth."""

    unit: str
    decimals: int


#: Channels in the order of the file. Spring pressures are those of gas springs beside the rod, absolute.
CHANNELS = {
    "t": Channel("s", 6),
    "current": Channel("A", 5),
    "current_measured": Channel("A", 5),
    "speed": Channel("rad/s", 4),
    "p1": Channel("Pa", 1),
    "p2": Channel("Pa", 1),
    "position": Channel("m", 7),
    "velocity": Channel("m/s", 7),
    "acceleration": Channel("m/s2", 5),
    "force": Channel("N", 3),
    "drive_force": Channel("N", 4),
    "spring_p1": Channel("Pa", 1),
    "spring_p2": Channel("Pa", 1),
}

#: A row may be this far from its place in the grid, in units of the sample time: loggers round their clocks.
TIME_TOLERANCE = 0.05

#: Longest step, in usual ones, over which jittered samples may be joined.
LONGEST_STEP = 5.0


@dataclass(frozen=True)
class Column:
    """Where a file keeps a channel: SI value = scale * column + offset; a negative scale turns the direction."""

    column: str
    scale: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not math.isfinite(self.scale) or self.scale == 0.0:
            raise InputError(f"scale = {self.scale:g}: must be a finite number other than 0")
        if not math.isfinite(self.offset):
            raise InputError(f"offset = {self.offset:g}: must be a finite number")


@dataclass(frozen=True)
class Log(TextResult):
    """A record with channels by name.

    Attributes
    ----------
    time: (N,) s.
    channels: name -> (N,) values in SI units; names as in CHANNELS.
    path: where it came from, if from a file.
    missing: channels that were looked for and are not there.
    notes: what was assumed in reading it, in sentences.
    before: what was recorded before this piece, if it was cut out of a longer log.
    label: what it is called beside others, see `named`; empty for the file's name.
    """

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    path: Path | None = field(default=None, compare=False)
    missing: tuple[str, ...] = ()
    before: Log | None = field(default=None, compare=False, repr=False)
    notes: tuple[str, ...] = field(default=(), compare=False)
    label: str = field(default="", compare=False, repr=False)

    @property
    def name(self) -> str:
        """What a title or a sentence calls it."""
        return self.label or (self.path.name if self.path else "a log")

    def __getitem__(self, channel: str) -> np.ndarray:
        try:
            return self.channels[channel]
        except (KeyError, TypeError):
            known = choices(channel, self.channels)
            raise InputError(f"{self.path or 'the log'}: has no column {shown(channel)}; {known}") from None

    def __len__(self) -> int:
        return self.time.size

    @property
    def sample_time(self) -> float:
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {len(self)} samples from {self.time[0]:g} to "
            f"{self.time[-1]:g} s, {1 / self.sample_time:.6g} Hz"
        ]
        for name, values in self.channels.items():
            unit = CHANNELS[name].unit if name in CHANNELS else ""
            lines.append(f"  {name:<16} {values.min():>12.5g} to {values.max():>12.5g} {unit}".rstrip())
        missing = [f"  missing: {', '.join(self.missing)}"] if self.missing else []
        return "\n".join([*lines, *missing, *(f"  {note}" for note in self.notes)])

    __repr__ = __str__

    def segment(self, start: float | None = None, stop: float | None = None, *, shortest: int = 2) -> Log:
        """The samples from `start` to `stop` [s, the log's own time], both included; None is the log's own end.

        Raises InputError if fewer than `shortest` samples are left.
        """
        slack = 1e-6 * self.sample_time
        first = 0 if start is None else int(np.searchsorted(self.time, start - slack))
        last = len(self) if stop is None else int(np.searchsorted(self.time, stop + slack, side="right"))
        if last - first < shortest:
            asked = f"{self.time[0] if start is None else start:g} to {self.time[-1] if stop is None else stop:g} s"
            raise InputError(
                f"{self.path or 'the log'}: from {asked} there are {max(last - first, 0)} samples; expected at least "
                f"{shortest} (the log runs from {self.time[0]:g} to {self.time[-1]:g} s)"
            )
        earlier = self._slice(0, first, self.before) if first >= 2 else self.before
        return self._slice(first, last, earlier)

    def rows(self, first: int, last: int) -> Log:
        """The samples from row `first` up to but without row `last`, as a log of their own."""
        return self._slice(first, last, None)

    def _slice(self, first: int, last: int, before: Log | None) -> Log:
        channels = {name: values[first:last] for name, values in self.channels.items()}
        return replace(self, time=self.time[first:last], channels=channels, before=before)

    def to_pandas(self) -> pandas.DataFrame:
        import pandas

        return pandas.DataFrame({"t": self.time, **self.channels})

    @classmethod
    def from_pandas(
        cls, frame: pandas.DataFrame, required: Sequence[str] = (), *, columns: Mapping[str, Column] | None = None
    ) -> Log:
        """A log out of a table in memory: time in a column t or in the index, channels by name, SI units.

        Arguments and errors are those of `read_log`; the first row of data is row 1.
        """
        from .table import table_of

        return _log("the table", table_of(frame, time="t" if columns is None else ""), required, columns)

    def write(self, path: str | Path) -> None:
        """Write in the format of a measured log: .parquet, .mat (version 5), else CSV with the sensors' decimals.

        A file of that name is replaced, once the new one is whole.

        Raises InputError for Parquet without pyarrow, and for a path that can't be written.
        """
        with atomic_write(path) as draft:
            self._write(Path(path), draft)

    def _write(self, path: Path, draft: Path) -> None:
        table = self.to_pandas()
        if path.suffix.lower() == ".mat":
            from scipy.io import savemat

            savemat(draft, {name: table[name].to_numpy() for name in table.columns})
            return
        if path.suffix.lower() in (".parquet", ".pq"):
            try:
                table.to_parquet(draft, index=False)
            except ImportError:
                raise InputError(
                    f'{path}: writing Parquet needs pyarrow; install it with pip install "ehsa_ctrl[parquet]"'
                ) from None
            return
        for name in table.columns:
            table[name] = table[name].round(CHANNELS[name].decimals if name in CHANNELS else 9)
        table.to_csv(draft, index=False)


def named(logs: Sequence[Log]) -> list[Log]:
    """The logs, those from files called so that they can be told apart."""
    if len(logs) < 2:
        return list(logs)
    labels = iter(unique_names([log.path for log in logs if log.path is not None]))
    return [log if log.path is None else replace(log, label=next(labels)) for log in logs]


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
    """Read a log by the ending of its file: .csv (header row), .parquet, .mat; with time t and uniform sampling.

    A CSV may have commas, semicolons, tabs or blanks between its columns, points or commas in its numbers, comment
    rows (# or %), a row of units below its header, and be in UTF-8, UTF-16 or Latin-1; `notes` of the log says what was
    assumed. What can be read in two ways is refused. A column that a row of units names is converted to SI units where
    its mapping gives no scale.

    Parameters
    ----------
    required: channels that have to be there; others of CHANNELS are read where they are there.
    columns: channel -> column of the file that holds it, "t" too. Channels that are not named here are found under
        their own name. A file that has none of these columns is taken for one in the tool's own format.
    uniform: False also takes time that jitters, but no gap of more than LONGEST_STEP usual steps.
    wanted: channels of interest beside the required ones: what is said of columns that are not mapped is about these.
    span: rows before and after these times [s] are not looked at.

    Raises
    ------
    InputError: no such file, no table, a form that can be read in two ways, a required column missing, a value that is
        no finite number, a unit that is not known or not that of the mapping, time that does not advance or has a gap,
        fewer than `shortest` rows; one sentence that names file, column and row (the first line of a CSV is row 1).
    """
    # Plants know this module for their [log]; pandas is loaded only where a file is read.
    from .table import read_table

    path = Path(path)
    log = _log(path, read_table(path), required, columns, shortest, uniform, wanted, span)
    return replace(log, path=path)


def _log(
    path: Path | str,
    table: Table,
    required: Sequence[str],
    columns: Mapping[str, Column] | None,
    shortest: int = 2,
    uniform: bool = True,
    wanted: Sequence[str] = (),
    span: tuple[float | None, float | None] = (None, None),
) -> Log:
    from .column_matching import channel_scale, find_channels, suggest_mapping

    places = find_channels(table, dict(columns or {}))
    lines = suggest_mapping(table, places, ("t", *required, *wanted))
    write = f"after a look at units and signs write {lines} under [log] in the plant's TOML" if lines else ""
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
        notes.append(f"{path}: converted as its row of units says: {', '.join(converted)}")
    for channel, at in (columns or {}).items():
        if channel in wanted and channel not in places:
            near = choices(at.column, table.names)
            notes.append(f"{path}: has no column {at.column!r}, where the plant's [log] looks for {channel}; {near}")
    if write:
        notes.append(f"{path}: has columns that look like channels and are not read; {write}")
    return Log(time, values, notes=tuple(notes))


def check_time(
    path: Path | str,
    time: np.ndarray,
    *,
    uniform: bool = True,
    first_row: int = 2,
    lines: np.ndarray | None = None,
) -> None:
    """Raise InputError unless time advances in equal steps; names the row of the first that does not.

    With uniform=False it may jitter, but neither stand still nor have a gap. lines: numbers of the rows, where they do
    not simply count up from first_row.
    """
    numbers = first_row + np.arange(time.size) if lines is None else lines
    step = np.diff(time)
    usual = float(np.median(step))
    if usual <= 0:
        raise InputError(f"{path}: column 't' does not advance; expected seconds, growing in equal steps")
    back = np.flatnonzero(step <= 0.0)
    if back.size:
        row = int(back[0])
        raise InputError(
            f"{path}: column 't', row {numbers[row + 1]}: {time[row + 1]:g} s comes after {time[row]:g} s; time "
            "must grow from row to row"
        )
    longest = 1.0 + 2 * TIME_TOLERANCE if uniform else LONGEST_STEP
    off = np.flatnonzero((step > longest * usual) | ((step < (1 - 2 * TIME_TOLERANCE) * usual) & uniform))
    if uniform and off.size > 0.02 * step.size and np.max(step) <= LONGEST_STEP * usual and off.size > 2:
        raise InputError(
            f"{path}: column 't' jitters: {off.size} of {step.size} steps differ by more than "
            f"{200 * TIME_TOLERANCE:.0f} % from {usual:g} s, the first in row {numbers[off[0] + 1]}; resample "
            f"it to a rate, for instance {1 / usual:.4g} Hz"
        )
    if off.size:
        row = int(off[0])
        what = "a gap" if step[row] > 1.5 * usual else "a step"
        raise InputError(
            f"{path}: column 't', row {numbers[row + 1]}: {what} of {step[row]:g} s after {time[row]:g} s, where "
            f"the other rows are {usual:g} s apart; expected uniform sampling"
        )
    grid = time[0] + (time[-1] - time[0]) * np.arange(time.size) / (time.size - 1)
    drift = np.flatnonzero(np.abs(time - grid) > 0.5 * usual)
    if uniform and drift.size:
        raise InputError(
            f"{path}: column 't', row {numbers[drift[0]]}: the sample time changes within the log; resample it "
            f"to one rate, for instance {1 / usual:.4g} Hz"
        )
