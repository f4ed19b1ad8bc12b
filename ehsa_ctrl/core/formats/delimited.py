"""Delimited text: the dialect of the file is detected, see `core/dialect.py`."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas

from ..dialect import read_dialect
from ..errors import InputError, reason
from ..table import LogTable
from ._format import Format


def _read(path: Path) -> tuple[LogTable, ...]:
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
        raise InputError(f"{path}: is not a CSV table with a header row ({reason(error)})") from None
    except csv.Error as error:
        raise InputError(f"{path}: is not a CSV table with a header row ({reason(error)})") from None
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
    return (LogTable(path, frame, lines, cell_text, dialect.decimal, dialect.units, dialect.units_row, notes),)


def _ragged(path: Path, row: int, got: int, expected: int, separator: str) -> InputError:
    """Error for a row whose length differs from the header's, with the usual cause."""
    reason = "a cell is missing"
    if got > expected:
        reason = "there is a cell too many"
        if separator == ",":
            reason += ", or numbers have decimal commas: save it with points, or with ';' between columns"
    return InputError(f"{path}: row {row} has {got} cells, but the header has {expected}: {reason}")


format = Format(
    name="CSV",
    suffixes=(".csv", ".txt", ".tsv", ".asc", ".dat"),
    contents="one table; time in a column",
    read=_read,
)
