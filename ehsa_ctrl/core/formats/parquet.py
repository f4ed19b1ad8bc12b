"""Apache Parquet, read with pandas and pyarrow."""

from __future__ import annotations

from pathlib import Path

import pandas

from ..table import LogTable, table_of
from ._format import Format


def _read(path: Path) -> tuple[LogTable, ...]:
    frame = pandas.read_parquet(path, engine="pyarrow")
    if frame.index.name is not None:
        frame = frame.reset_index()
    return (table_of(path, frame),)


format = Format(
    name="Parquet",
    suffixes=(".parquet", ".pq"),
    contents="one table; time in a column or the index",
    read=_read,
    modules=("pyarrow",),
    extra="parquet",
    magic=(b"PAR1",),
)
