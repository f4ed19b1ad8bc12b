"""Measured logs: channels in SI units by name, as commands use them, and writing them to files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .errors import InputError, choices, shown
from .files import atomic_write
from .result import Result
from .text import unique_names

if TYPE_CHECKING:
    import pandas

    from .resampling import RateChange


class Channel(NamedTuple):
    """SI unit of a channel, and the decimals that its sensor resolves."""

    unit: str
    decimals: int


#: Channels in the order of the columns. spring_p1 and spring_p2 are absolute pressures of gas springs at the rod;
#: reference is the target position of the controller under which the log was recorded.
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
    "reference": Channel("m", 7),
    "reference_velocity": Channel("m/s", 7),
    "reference_acceleration": Channel("m/s2", 5),
}
#: What the controller of the rig was asked for: no sensor measures it, and no plant simulates it.
REFERENCES = ("reference", "reference_velocity", "reference_acceleration")


#: Tolerance of the sampling grid, in sample times. Engineering judgement: loggers round their time stamps, 4 ms to
#: 0.1 ms for instance.
TIME_TOLERANCE = 0.05

#: Share of repeated stamps above which they are taken for too coarse instead of wrong. Engineering judgement.
COARSE = 0.3

#: Longest step of an uneven log that is interpolated, in median steps; a longer one is a gap. Engineering judgement.
LONGEST_STEP = 5.0


@dataclass(frozen=True)
class Column:
    """Column of a file with a channel: SI value = scale * column + offset; a negative scale reverses the sign."""

    column: str
    scale: float = 1.0
    offset: float = 0.0
    #: Whether the scale, which may be 1, was given: then it holds whatever the file says of the unit.
    scale_given: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        if not math.isfinite(self.scale) or self.scale == 0.0:
            raise InputError(f"scale = {self.scale:g}: must be a finite number other than 0")
        if not math.isfinite(self.offset):
            raise InputError(f"offset = {self.offset:g}: must be a finite number")


@dataclass(frozen=True, repr=False)
class Log(Result):
    """A measured log.

    Attributes
    ----------
    time: (N,) s.
    channels: name -> (N,) values in SI units; names as in CHANNELS.
    path: its file, if any.
    missing: requested channels that the file lacks.
    notes: sentences on what was assumed in reading it.
    before: the samples before this segment of a longer log, if any.
    label: name that distinguishes it from other logs, see `named`; empty for the file's name.
    settings: symbol -> value of a parameter that was set for this log alone, SI units, such as a gain of the firmware.
    rates: how its channels were brought to one rate, if the file has several.
    time_source: what gave the time, if not a column: wf_increment, for instance, or a given sample time.
    start: date of time 0 [s since 1970, UTC], if the file has dates.
    """

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    path: Path | None = field(default=None, compare=False)
    missing: tuple[str, ...] = ()
    before: Log | None = field(default=None, compare=False, repr=False)
    notes: tuple[str, ...] = field(default=(), compare=False)
    label: str = field(default="", compare=False, repr=False)
    settings: Mapping[str, float] = field(default_factory=dict)
    rates: RateChange | None = field(default=None, compare=False, repr=False)
    time_source: str = field(default="", compare=False, repr=False)
    start: float | None = field(default=None, compare=False, repr=False)

    @property
    def name(self) -> str:
        """Name in titles and messages."""
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
        notes = [*self.notes, *([str(self.rates)] if self.rates else [])]
        return "\n".join([*lines, *missing, *(f"  {note}" for note in notes)])

    def segment(self, start: float | None = None, stop: float | None = None, *, shortest: int = 2) -> Log:
        """The samples from `start` to `stop` [s, the log's own time], both included; None is the end of the log.

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
        """Rows `first` to `last` - 1 as a separate log, without `before`."""
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
        """A log from a table in memory: time in a column t or in the index, channels by name, SI units.

        Arguments and errors as in `read_log`; the first row of data is row 1.
        """
        from .log_reader import log_from_tables
        from .table import table_from_pandas

        table = table_from_pandas(frame, time="t" if columns is None else "")
        return log_from_tables("the table", [table], required, columns)

    def write(self, path: str | Path) -> None:
        """Write the log to .parquet, .mat (version 5) or otherwise CSV, with as many decimals as sensors resolve.

        An existing file is replaced when the new one is complete.

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
    """The logs with labels that distinguish them, see `unique_names`."""
    if len(logs) < 2:
        return list(logs)
    labels = iter(unique_names([log.path for log in logs if log.path is not None]))
    return [log if log.path is None else replace(log, label=next(labels)) for log in logs]


def check_time(
    path: Path | str,
    time: np.ndarray,
    *,
    uniform: bool = True,
    first_row: int = 2,
    lines: np.ndarray | None = None,
    what: str = "column 't'",
) -> None:
    """Raise InputError, naming the row, unless time advances in equal steps.

    uniform: False also accepts jitter, but no gaps. lines: row numbers for messages, by default from first_row on.
    what: the name of the time in messages.
    """
    numbers = first_row + np.arange(time.size) if lines is None else lines
    step = np.diff(time)
    usual = float(np.median(step))
    repeated = int(np.sum(step == 0.0))
    if repeated > COARSE * step.size and np.all(step >= 0.0) and time[-1] > time[0]:
        mean = (time[-1] - time[0]) / step.size
        raise InputError(
            f"{path}: {what} repeats {repeated} of {step.size} stamps: it is coarser than the sampling; give the "
            f"sample time of the rows (--sample-time {mean:.4g}, the mean over the log, if no row is lost)"
        )
    if usual <= 0:
        raise InputError(f"{path}: {what} does not advance; expected seconds that increase in equal steps")
    back = np.flatnonzero(step <= 0.0)
    if back.size:
        row = int(back[0])
        raise InputError(
            f"{path}: {what}, row {numbers[row + 1]}: {time[row + 1]:g} s comes after {time[row]:g} s; time "
            "must increase from row to row"
        )
    longest = 1.0 + 2 * TIME_TOLERANCE if uniform else LONGEST_STEP
    off = np.flatnonzero((step > longest * usual) | ((step < (1 - 2 * TIME_TOLERANCE) * usual) & uniform))
    if uniform and off.size > 0.02 * step.size and np.max(step) <= LONGEST_STEP * usual and off.size > 2:
        raise InputError(
            f"{path}: {what} jitters: {off.size} of {step.size} steps differ by more than "
            f"{200 * TIME_TOLERANCE:.0f} % from {usual:g} s, the first in row {numbers[off[0] + 1]}; resample "
            f"it to a rate, for instance {1 / usual:.4g} Hz"
        )
    if off.size:
        row = int(off[0])
        jump = "a gap" if step[row] > 1.5 * usual else "a step"
        raise InputError(
            f"{path}: {what}, row {numbers[row + 1]}: {jump} of {step[row]:g} s after {time[row]:g} s, but the "
            f"other rows are {usual:g} s apart; expected uniform sampling: select a part of the log that has it"
        )
    grid = time[0] + (time[-1] - time[0]) * np.arange(time.size) / (time.size - 1)
    drift = np.flatnonzero(np.abs(time - grid) > 0.5 * usual)
    if uniform and drift.size:
        raise InputError(
            f"{path}: {what}, row {numbers[drift[0]]}: the sample time changes within the log; resample it "
            f"to one rate, for instance {1 / usual:.4g} Hz"
        )
