"""What figures over frequency share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MultipleLocator, NullFormatter

from ..style import GREY

#: Height of two lines of words, in.
STEP = 0.33


def mark(axes: Sequence[Axes], frequency: float) -> None:
    """A dotted line at a frequency [rad/s] through the panels."""
    for ax in axes:
        ax.axvline(frequency, color=GREY, linestyle=(0, (2, 2)), linewidth=0.9)


class Mark(NamedTuple):
    """Two lines of words above a panel, at a frequency [rad/s], so many steps up."""

    frequency: float
    words: str
    side: str
    level: int


def arranged(marks: Iterable[tuple[float, str]], low: float, high: float, *, width: float) -> list[Mark]:
    """Words at their frequencies [rad/s] on an axis from low to high, a step up where two would meet.

    `width` is what words take of the axis' width. Words near an end of the axis stand inside it.
    """
    ends: list[float] = []
    placed = []
    for frequency, words in sorted(marks):
        place = np.log(frequency / low) / np.log(high / low)
        side, start = "center", place - width / 2
        if start < 0:
            side, start = "left", place
        elif start + width > 1:
            side, start = "right", place - width
        level = next((k for k, end in enumerate(ends) if start >= end), len(ends))
        ends[level : level + 1] = [start + width]
        placed.append(Mark(frequency, words, side, level))
    return placed


def header(marks: Iterable[Mark]) -> float:
    """Room that the words need, in."""
    return STEP * (1 + max((one.level for one in marks), default=-1)) + 0.08


def name_marks(ax: Axes, marks: Iterable[Mark]) -> None:
    """Write the words above the panel."""
    for frequency, words, side, level in marks:
        ax.annotate(
            words, (frequency, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3 + 72 * STEP * level),
            textcoords="offset points", ha=side, va="bottom", fontsize=8, color="#333333",
        )  # fmt: skip


def few_ticks(axes: Iterable[Axes]) -> None:
    """Small ticks at 2 and 5 only, on each logarithmic axis: all eight take half of the time of drawing."""
    for ax in axes:
        for axis in (ax.xaxis, ax.yaxis):
            if axis.get_scale() == "log":
                axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
                axis.set_minor_formatter(NullFormatter())


def degrees(ax: Axes) -> None:
    """Ticks at multiples of 45 or 90 deg, and the range that the curve takes."""
    low, high = ax.dataLim.y0, ax.dataLim.y1
    step = 45 if high - low <= 200 else 90
    middle, half = (low + high) / 2, max((high - low) / 2 * 1.12, 60.0)
    ax.set_ylim(middle - half, middle + half)
    ax.yaxis.set_major_locator(MultipleLocator(step))
