"""A measured record: uniformly sampled channels in SI units, from a CSV and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas

from .errors import InputError, choices

#: Channels in the order of the file, and the decimals that their sensors are worth.
DECIMALS = {"t": 6, "current": 5, "speed": 4, "p1": 1, "p2": 1, "position": 7, "force": 3}

#: A row may be this far from its place in the grid, in units of the sample time: loggers round their clocks.
TIME_TOLERANCE = 0.05


@dataclass(frozen=True)
class Log:
    """A record with channels by name.

    Attributes
    ----------
    time: (N,) s.
    channels: name -> (N,) values in SI units; names as in DECIMALS.
    path: where it came from, if from a file.
    """

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    path: Path | None = field(default=None, compare=False)

    def __getitem__(self, channel: str) -> np.ndarray:
        if channel not in self.channels:
            raise InputError(f"{self.path or 'the log'}: has no column {channel!r}; {choices(channel, self.channels)}")
        return self.channels[channel]

    def __len__(self) -> int:
        return self.time.size

    @property
    def sample_time(self) -> float:
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    def to_pandas(self) -> pandas.DataFrame:
        return pandas.DataFrame({"t": self.time, **self.channels})

    def write(self, path: Path) -> None:
        """Write as CSV in the format of a measured log."""
        table = self.to_pandas()
        for name in table.columns:
            table[name] = table[name].round(DECIMALS.get(name, 9))
        table.to_csv(path, index=False)


def read_log(path: str | Path, required: Sequence[str], *, shortest: int = 2) -> Log:
    """Read a CSV with a header row, a column t and uniform sampling.

    Raises
    ------
    InputError: no such file, no table, a required column missing, a value that is no finite number, time that does
        not advance or has a gap, fewer than `shortest` rows; one sentence that names file, column and row (the
        header is row 1).
    """
    path = Path(path)
    try:
        table = pandas.read_csv(path, skipinitialspace=True)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, pandas.errors.ParserError, pandas.errors.EmptyDataError) as error:
        raise InputError(f"{path}: is no CSV table with a header row ({str(error).strip()})") from None
    for column in ("t", *required):
        if column not in table.columns:
            raise InputError(f"{path}: has no column {column!r}; {choices(column, [str(c) for c in table.columns])}")
    if len(table) < shortest:
        raise InputError(f"{path}: has {len(table)} rows of data; expected at least {shortest}")
    values = {}
    for column in table.columns:
        if column not in ("t", *required) and column not in DECIMALS:
            continue
        numbers = pandas.to_numeric(table[column], errors="coerce").to_numpy(dtype=float)
        bad = np.flatnonzero(~np.isfinite(numbers))
        if bad.size:
            row = int(bad[0])
            raise InputError(
                f"{path}: column {column!r}, row {row + 2}: {str(table[column].iloc[row])!r} is no finite number"
            )
        values[str(column)] = numbers
    time = values.pop("t")
    check_time(path, time)
    return Log(time, values, path)


def check_time(path: Path | str, time: np.ndarray) -> None:
    """Raise InputError unless time advances in equal steps; names the row of the first that does not."""
    step = np.diff(time)
    usual = float(np.median(step))
    if usual <= 0:
        raise InputError(f"{path}: column 't' does not advance; expected seconds, growing in equal steps")
    grid = time[0] + (time[-1] - time[0]) * np.arange(time.size) / (time.size - 1)
    off = np.flatnonzero(np.abs(step - usual) > 2 * TIME_TOLERANCE * usual)
    if off.size:
        row = int(off[0])
        what = "a gap" if step[row] > 1.5 * usual else "a step"
        raise InputError(
            f"{path}: column 't', row {row + 3}: {what} of {step[row]:g} s after {time[row]:g} s, where the other rows "
            f"are {usual:g} s apart; expected uniform sampling"
        )
    drift = np.flatnonzero(np.abs(time - grid) > 0.5 * usual)
    if drift.size:
        raise InputError(f"{path}: column 't', row {int(drift[0]) + 2}: the sample time changes within the log")
