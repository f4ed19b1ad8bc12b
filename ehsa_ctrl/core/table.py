"""Read tables from CSV, Parquet and MAT files; each error is one sentence with file, column and row."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas

from .dialect import read_dialect
from .errors import InputError


@dataclass(frozen=True)
class LogTable:
    """The columns of a file, before they are matched to channels.

    lines: number of each row for messages (in a CSV that of the line, from 1).
    text: (column, row number) -> text of the cell. decimal: decimal mark.
    units: column -> unit, from a row of units. units_row: number of that row, 0 without one.
    notes: sentences on what was assumed in reading.
    """

    path: Path
    frame: pandas.DataFrame
    lines: np.ndarray
    text: Callable[[str, int], str]
    decimal: str = "."
    units: Mapping[str, str] = field(default_factory=dict)
    units_row: int = 0
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        return [str(name) for name in self.frame.columns]

    def within(self, column: str, scale: float, offset: float, span: tuple[float | None, float | None]) -> LogTable:
        """The rows whose scale * column + offset lies in the span; rows without a number there are dropped."""
        values = pandas.to_numeric(self.frame[column], errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        first, last = -np.inf if span[0] is None else span[0], np.inf if span[1] is None else span[1]
        kept = (scale * values + offset >= first) & (scale * values + offset <= last)
        return replace(self, frame=self.frame[kept].reset_index(drop=True), lines=self.lines[kept])

    def numbers(self, column: str) -> np.ndarray:
        """A column (N,) of finite numbers. Raises InputError with column and row of the first cell that is not one."""
        series = self.frame[column]
        if series.dtype.kind in "mM":
            raise InputError(f"{self.path}: column {column!r} contains dates or durations; expected plain numbers")
        values = pandas.to_numeric(series, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            row = int(self.lines[bad[0]])
            text = self.text(column, row)
            if not text:
                raise InputError(
                    f"{self.path}: column {column!r}, row {row}: the cell is empty; every row needs a number"
                )
            comma = self.decimal == "." and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", text)
            remedy = "correct it, or use a part of the log without it"
            if comma:
                remedy = f"write decimals with a point, {text.strip().replace(',', '.')}"
            raise InputError(f"{self.path}: column {column!r}, row {row}: {text!r} is not a finite number; {remedy}")
        return values


def read_table(path: Path) -> LogTable:
    """Read .csv, .parquet (.pq) or .mat; any other ending counts as CSV.

    A MAT file contains one vector per channel, or one structure with such fields.

    Raises
    ------
    InputError: no such file, a folder, or not a table of this kind.
    """
    try:
        folder = path.is_dir()
        path.stat()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: is not a file name") from None
    if folder:
        raise InputError(f"{path}: is a folder; give the file of one log")
    readers = {".parquet": _parquet, ".pq": _parquet, ".mat": _mat}
    table = readers.get(path.suffix.lower(), _csv)(path)
    twice = [name for name, times in Counter(table.names).items() if times > 1]
    if twice:
        raise InputError(f"{path}: has more than one column {min(twice)!r}; rename all but one")
    return table


def table_from_pandas(frame: pandas.DataFrame, *, time: str = "") -> LogTable:
    """A table in memory. A named index becomes a column; an unnamed one becomes the column `time` if there is no such
    column and the index is more than row numbers."""
    if frame.index.name is not None:
        frame = frame.reset_index()
    elif time and time not in frame.columns and not isinstance(frame.index, pandas.RangeIndex):
        frame = frame.rename_axis(time).reset_index()
    return _from_frame(Path("the table"), frame)


def _csv(path: Path) -> LogTable:
    try:
        dialect = read_dialect(path)
        header = list(dialect.names)
        if dialect.rows and len(dialect.cells(0)) != len(header):
            raise _ragged(path, dialect.numbers[0], len(dialect.cells(0)), len(header), dialect.separator)
        # Blank lines are kept, so that row numbers are line numbers. Columns get numbers as names, because pandas would
        # take an extra cell in each row for an index.
        mark = " " if dialect.separator == r"\s+" else dialect.separator
        text = "\n".join([mark.join(map(str, range(len(header)))), *dialect.rows])
        frame = pandas.read_csv(
            io.StringIO(text), sep=dialect.separator, decimal=dialect.decimal, skipinitialspace=True, low_memory=False,
            skip_blank_lines=False,
        )  # fmt: skip
    except pandas.errors.ParserError as error:
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found:
            raise _ragged(
                path, dialect.numbers[int(found[2]) - 2], int(found[3]), int(found[1]), dialect.separator
            ) from None
        raise InputError(f"{path}: is not a CSV table with a header row ({_reason(error)})") from None
    except csv.Error as error:
        raise InputError(f"{path}: is not a CSV table with a header row ({_reason(error)})") from None
    filled = np.flatnonzero(frame.notna().any(axis=1))
    frame = frame.iloc[: filled[-1] + 1 if filled.size else 0]
    lines = np.array(dialect.numbers[: len(frame)], dtype=int)
    # A separator at the end of each row makes a column without name and numbers; drop it.
    kept = [i for i, name in enumerate(header) if name or frame[str(i)].notna().any()]
    frame, names = frame[[str(i) for i in kept]], [header[i] for i in kept]
    twice = [name for name, times in Counter(names).items() if times > 1]
    if twice:
        raise InputError(
            f"{path}: row {dialect.header_row} names the column {twice[0]!r} more than once; rename all but one"
        )
    frame.columns = pandas.Index(names)
    if dialect.decimal == ",":
        # pandas keeps a column as text, with commas, if one of its cells is not a number.
        frame = frame.apply(lambda c: c if c.dtype.kind in "iufb" else c.str.replace(",", ".", regex=False))

    def cell_text(column: str, row: int) -> str:
        cells = dialect.cells(dialect.numbers.index(row))
        if not cells or cells == [""]:
            raise InputError(f"{path}: row {row} is empty; every row needs {len(header)} numbers")
        if len(cells) != len(header):
            raise _ragged(path, row, len(cells), len(header), dialect.separator)
        return cells[header.index(column)]

    notes = (dialect.note,) if dialect.note else ()
    return LogTable(path, frame, lines, cell_text, dialect.decimal, dialect.units, dialect.units_row, notes)


def _ragged(path: Path, row: int, got: int, expected: int, separator: str) -> InputError:
    """Error for a row whose length differs from the header's, with the usual cause."""
    reason = "a cell is missing"
    if got > expected:
        reason = "there is a cell too many"
        if separator == ",":
            reason += ", or numbers have decimal commas: save it with points, or with ';' between columns"
    return InputError(f"{path}: row {row} has {got} cells, but the header has {expected}: {reason}")


def _parquet(path: Path) -> LogTable:
    try:
        frame = pandas.read_parquet(path)
    except ImportError:
        raise InputError(
            f'{path}: reading Parquet needs pyarrow; install it with pip install "ehsa_ctrl[parquet]"'
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is not a Parquet table ({_reason(error)})") from None
    if frame.index.name is not None:
        frame = frame.reset_index()
    return _from_frame(path, frame)


def _mat(path: Path) -> LogTable:
    from scipy.io import loadmat

    try:
        content: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InputError(f"{path}: is a MAT file of version 7.3; save it with -v7") from None
    except Exception as error:  # scipy raises whatever its parsing of a broken file runs into
        raise InputError(f"{path}: is not a MAT file ({_reason(error)})") from None
    content = {name: value for name, value in content.items() if not name.startswith("__")}
    vectors = _vectors(content)
    structures = {name: _vectors(value) for name, value in content.items() if isinstance(value, Mapping)}
    structures = {name: fields for name, fields in structures.items() if fields}
    if not vectors:
        if len(structures) != 1:
            what = f"the structures {', '.join(sorted(structures))}" if structures else "neither"
            raise InputError(
                f"{path}: expected one vector per channel, or one structure of vectors, but it contains {what}"
            )
        (vectors,) = structures.values()
    longest = max(vectors.values(), key=len)
    for name, vector in vectors.items():
        if len(vector) != len(longest):
            raise InputError(
                f"{path}: {name!r} has {len(vector)} values, but others have {len(longest)}; all need the same length"
            )
    return _from_frame(path, pandas.DataFrame(vectors))


def _vectors(content: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Name -> vector, for the numeric vectors in a MAT file's content."""
    return {
        name: value
        for name, value in content.items()
        if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub" and value.size > 1
    }


def _from_frame(path: Path, frame: pandas.DataFrame) -> LogTable:
    def cell_text(column: str, row: int) -> str:
        value = frame[column].iloc[row - 1]
        return "" if value is None else str(value)

    return LogTable(path, frame, np.arange(1, len(frame) + 1), cell_text)


def _reason(error: Exception) -> str:
    """The library's message on one line, shortened if it is long."""
    return " ".join(str(error).split())[:160] or type(error).__name__
