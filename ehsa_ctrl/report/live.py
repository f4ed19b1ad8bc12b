"""The numbers of live charts: read from CSV, thinned with their extremes kept, and packed for the page.

A value becomes a 16-bit integer between the line's least and largest value, which is finer than any screen. The browser
decompresses what zlib compressed: a smooth line of 6000 samples takes 5 kB of a page, a noisy one 10 kB.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import InputError
from .chart import Chart, RegimeCurve, Strip
from .signals import spans
from .text import unit

#: Values of all charts of a page: about 200 kB in it, so that a page with its printed figures stays below 1 MB.
VALUES = 150_000
#: A line with fewer samples than this shows nothing when it is enlarged (engineering judgement).
FEWEST = 500
#: Code for a missing value; the others are -32767 to 32767.
MISSING, LARGEST = -32768, 32767
#: Distribution on PyPI that ships uPlot, and its files.
PACKAGE, SCRIPT, STYLE = "uplot-python", "uplot/static/uPlot.iife.js", "uplot/static/uPlot.min.css"


class ChartLibrary(NamedTuple):
    """uPlot: JavaScript and style."""

    script: str
    style: str


@cache
def chart_library() -> ChartLibrary | None:
    """uPlot (MIT) as installed by the extra `live`; None if it is not.

    Its files are read without importing the package, which would import IPython.
    """
    try:
        found = distribution(PACKAGE)
        script, style = (Path(str(found.locate_file(name))).read_text(encoding="utf-8") for name in (SCRIPT, STYLE))
    except (PackageNotFoundError, OSError, ValueError):
        return None
    if "</" in style or "</script" in script.lower():
        return None
    # The package has the readable script only: without indentation and lines of comment it is a fifth shorter.
    lines = (line.strip() for line in script.splitlines())
    return ChartLibrary("\n".join(line for line in lines if line and not line.startswith("//")), style)


def thin(values: np.ndarray, bins: int) -> np.ndarray:
    """The least and the largest value of each of `bins` parts of values (N,), in the order in which they occur.

    Shape (2 bins,): two values per part, so that all lines of a chart share their times. numpy does it in some lines;
    a library that returns other samples for every line would need a time axis for each. A part without values is nan.
    """
    starts, stops = (edges := np.linspace(0, values.size, bins + 1).astype(int))[:-1], edges[1:]
    # A row per part; a shorter part repeats its last sample.
    parts = values[np.minimum(starts[:, None] + np.arange(np.max(stops - starts)), stops[:, None] - 1)]
    none = ~np.isfinite(parts)
    ends = (np.argmin(np.where(none, np.inf, parts), axis=1), np.argmax(np.where(none, -np.inf, parts), axis=1))
    found = np.take_along_axis(parts, np.sort(np.column_stack(ends), axis=1), axis=1)
    return np.where(none.all(axis=1, keepdims=True), np.nan, found).ravel()


def encode(values: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Least and largest value of a line (N,), and its 16-bit codes between them; nan and infinity are MISSING."""
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
    codes = np.full(values.size, MISSING, dtype=np.int16)
    span = (high - low) or 1.0
    codes[known] = np.round((values[known] - low) / span * 2 * LARGEST) - LARGEST
    return low, low + span, codes


def pack(codes: Sequence[np.ndarray]) -> str:
    """Codes of all lines, (N,) each, as base64 of their compressed differences.

    A line that is smooth has small differences: all low bytes and then all high bytes take a third of the codes.
    """
    lines = np.array(codes, dtype=np.int16).view(np.uint16)
    steps = np.diff(lines, axis=1, prepend=np.uint16(0)).ravel()
    planes = np.concatenate([steps & 0xFF, steps >> 8]).astype(np.uint8)
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()


def payload(chart: Chart, folder: Path, samples: int) -> dict[str, Any]:
    """A chart as the script of a page reads it.

    samples: of each line at most; a longer one is thinned.

    Raises InputError for a file that is missing, that lacks a column, or whose time does not rise.
    """
    tables: dict[str, Mapping[str, np.ndarray]] = {}

    def column(name: str, file: str) -> np.ndarray:
        file = file or chart.file
        if file not in tables:
            tables[file] = _read(folder / file)
        if name not in tables[file]:
            raise InputError(f"{folder / file}: has no column {name}; make the result again")
        return tables[file][name]

    time = column("t", "")
    size, bins = time.size, max(samples // 2, 1)
    if size < 2 or not np.all(np.diff(time) > 0.0):
        raise InputError(f"{folder / chart.file}: the column t must rise from row to row; make the result again")

    codes: list[np.ndarray] = []

    def line_of(name: str, file: str, scale: float) -> dict[str, Any]:
        values = column(name, file) / scale
        # Controllers of one scenario may differ in their sample time.
        own = column("t", file)
        if own.size != size:
            values = np.interp(time, own, values, right=np.nan)
        low, high, line = encode(thin(values, bins) if size > 2 * bins else values)
        codes.append(line)
        return {"low": low, "high": high}

    panels = []
    for panel in chart.panels:
        lines = []
        for line in panel.lines:
            look = {"label": line.label, "switches": line.switches, "stepped": line.stepped, "bounded": line.bounded}
            lines.append(look | line.look._asdict() | line_of(line.column, line.file, panel.how.scale))
        panels.append({"name": panel.how.words.replace("\n", " "), "unit": unit(panel.how.unit), "lines": lines})
    return {
        "heading": chart.heading,
        "start": float(time[0]),
        "end": float(time[-1]),
        "samples": 2 * bins if size > 2 * bins else size,
        "thinned": size if size > 2 * bins else 0,
        "panels": panels,
        "codes": pack(codes),
        "switches": [
            {"key": each.key, "label": each.label, "on": each.on} | (each.look._asdict() if each.look else {})
            for each in chart.switches
        ],
        "strips": [_strip(strip, column) for strip in chart.strips],
        "shaded": [list(span) for span in chart.shaded],
        "regimes": [_regime(regime, column) for regime in chart.regimes],
        "swap": chart.swap,
    }


def _strip(strip: Strip, column: Any) -> dict[str, Any]:
    time, values = column("t", strip.file), column(strip.column, strip.file)
    on = values == 0.0 if strip.still else (values < strip.low) | (values > strip.high)
    parts = [[round(start, 6), round(end, 6)] for start, end in spans(time, on)]
    return {"label": strip.label, "colour": strip.colour, "spans": parts}


def _regime(regime: RegimeCurve, column: Any) -> dict[str, Any]:
    time, bins = column("t", regime.file), column(regime.column, regime.file)
    return {
        "label": regime.label,
        "across": regime.across,
        "up": regime.up,
        "unit": regime.unit,
        "points": [list(point) for point in regime.points],
        "start": float(time[0]),
        "end": float(time[-1]),
        # A byte per sample: a regime has far fewer bins than 256.
        "codes": base64.b64encode(np.clip(np.nan_to_num(bins), 0, 255).astype(np.uint8).tobytes()).decode(),
    }


def payloads(charts: Sequence[tuple[Chart, Path]]) -> list[dict[str, Any] | str]:
    """The charts of a page with their folders, or a sentence for each that can't be shown.

    All lines together have at most VALUES values; charts beyond that are left out.
    """
    lines = sum(len(chart.lines) for chart, _ in charts)
    samples = max(VALUES // max(lines, 1), FEWEST)
    found: list[dict[str, Any] | str] = []
    left = VALUES
    for chart, folder in charts:
        left -= samples * len(chart.lines)
        if left < 0:
            found.append("The page has no room for more charts that zoom; a page of fewer results shows them.")
            continue
        try:
            found.append(payload(chart, folder, samples))
        except InputError as error:
            found.append(f"There is no chart that zooms: {error}.")
    return found


def _read(path: Path) -> dict[str, np.ndarray]:
    import pandas

    try:
        table = pandas.read_csv(path)
        return {str(name): table[name].to_numpy(dtype=float) for name in table}
    except (OSError, ValueError, TypeError, pandas.errors.ParserError) as error:
        why = error.strerror if isinstance(error, OSError) else "is not a table of numbers"
        raise InputError(f"{path}: can't be read ({why}); make the result again") from None
