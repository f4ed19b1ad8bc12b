"""A table of many rows with small lines over time, which a page's script draws, filters and sorts.

Without scripts and in print it is a plain table with one small line a row.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .page import Table

#: Values of all small lines of a page: 300 kB as base64. Longer series are averaged.
VALUES = 110_000
#: A column shows values up to this many times their usual spread over the rows, so that one extreme row does not
#: flatten all others (engineering judgement).
WIDEST = 8.0
#: Standard deviation over the median absolute deviation, of normal values.
NORMAL = 1.4826
#: Code for a missing value; the others are -32767 to 32767.
MISSING, LARGEST = -32768, 32767
#: Size of a small line without scripts, px.
WIDTH, HEIGHT = 60, 22


class GridColumn(NamedTuple):
    """A quantity: name, unit (SI), and the value that the line in the middle of its cells stands for."""

    name: str
    unit: str
    middle: float


class GridRow(NamedTuple):
    """State ("changed", "unlike" or ""), days of its values, and per column values [SI] or None; marked: column of a
    change, -1 for none, and its day.
    """

    state: str
    days: Sequence[float]
    values: Sequence[Sequence[float] | None]
    marked: int = -1
    since: float = float("nan")


@dataclass(frozen=True, eq=False)
class Grid:
    """table: the texts, row by row as in `rows`. states: of rows -> words for the choice of rows."""

    table: Table
    columns: Sequence[GridColumn]
    rows: Sequence[GridRow]
    states: Mapping[str, str]

    @property
    def texts(self) -> list[Any]:
        """Its texts, for `page.check`."""
        return [
            self.table,
            [text for each in self.columns for text in (each.name, each.unit)],
            list(self.states.values()),
        ]

    @property
    def _period(self) -> tuple[float, float]:
        """First and last day of all rows, which share one axis of time."""
        days = [day for row in self.rows for day in row.days] or [0.0]
        return min(days), max(days)

    def sparks(self) -> Iterator[str]:
        """Points of the line of each row's change, for an SVG of WIDTH x HEIGHT; empty for a row without a change."""
        first, last = self._period
        for row, coded in zip(self.rows, self._coded(), strict=True):
            codes = coded[row.marked] if row.marked >= 0 else np.empty(0)
            across, up = (WIDTH - 6) / ((last - first) or 1.0), 0.45 * HEIGHT / LARGEST
            yield " ".join(
                f"{3 + across * (day - first):.1f},{HEIGHT / 2 - up * code:.1f}"
                for day, code in zip(row.days, codes, strict=False)
                if code != MISSING
            )

    @property
    def content(self) -> dict[str, Any]:
        """The numbers, as the page's script reads them."""
        ranges = self._ranges()
        rows = [
            {
                "state": row.state,
                "days": [round(float(day), 2) for day in days],
                "codes": base64.b64encode(codes.astype("<i2").tobytes()).decode(),
                "marked": row.marked,
                "since": None if np.isnan(row.since) else round(row.since, 2),
            }
            for row, (days, codes) in zip(self.rows, self._shortened(), strict=True)
        ]
        columns = [
            {**column._asdict(), "range": float(f"{reach:.4g}")}
            for column, reach in zip(self.columns, ranges, strict=True)
        ]
        return {"period": list(self._period), "columns": columns, "rows": rows, "states": dict(self.states)}

    def _ranges(self) -> list[float]:
        """Largest deviation from the middle that each column shows."""
        found = []
        for k, column in enumerate(self.columns):
            values = np.array([value for row in self.rows for value in row.values[k] or ()], dtype=float)
            values = values[np.isfinite(values)] - column.middle
            if not values.size:
                found.append(1.0)
                continue
            usual = NORMAL * float(np.median(np.abs(values - np.median(values))))
            largest = float(np.max(np.abs(values)))
            found.append((min(largest, WIDEST * usual) if usual > 0 else largest) or 1.0)
        return found

    def _coded(self) -> Iterator[np.ndarray]:
        """16-bit codes (columns, days) of each row; a value beyond the range is at its end."""
        ranges = self._ranges()
        for row in self.rows:
            codes = np.full((len(self.columns), len(row.days)), MISSING, dtype=int)
            for k, (column, values) in enumerate(zip(self.columns, row.values, strict=True)):
                if values is not None:
                    share = (np.asarray(values, float) - column.middle) / ranges[k]
                    known = np.isfinite(share)
                    codes[k, known] = np.round(np.clip(share[known], -1.0, 1.0) * LARGEST)
            yield codes

    def _shortened(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Days and codes of each row, averaged over neighbours until the page has room for all."""
        most = max(VALUES // max(len(self.columns) * len(self.rows), 1), 2)
        for row, codes in zip(self.rows, self._coded(), strict=True):
            days = np.asarray(row.days, float)
            if days.size <= most:
                yield days, codes
                continue
            edges = np.linspace(0, days.size, most + 1).astype(int)
            parts = np.ma.masked_equal(codes, MISSING)
            means = [parts[:, a:b].mean(axis=1).filled(MISSING) for a, b in zip(edges[:-1], edges[1:], strict=True)]
            yield (
                np.array([days[a:b].mean() for a, b in zip(edges[:-1], edges[1:], strict=True)]),
                np.column_stack(means),
            )
