"""Is anything left in the residuals: their correlation with themselves and with what they must not know of."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.errors import InputError
from ...identification.identification import Identification
from ...identification.residual_tests import LEVEL, Correlation
from ..channel import shown
from ..style import BLUE, GREY, VERMILION, WIDTH, style
from ._layout import GAP, sheet, stack

#: Height of a panel, of the header, between two panels above each other and side by side, and what is left, in.
ROW, HEADER, BETWEEN, ASIDE, LEFT, RIGHT = 1.0, 0.5, 0.2, 0.55, 0.95, 0.15


def residuals_figure(identification: Identification) -> Figure:
    """Correlation of each channel's whitened residual with itself, the drive, sign(v) and x over the lag [samples].

    A row a channel, a column what it is held against. In 99 of 100 logs a right model stays in the bands at all lags of
    all panels; what lies outside is drawn darker, and above each panel stands the largest.

    Raises InputError if there are no residual tests.
    """
    tests = identification.residual_tests
    if not tests:
        raise InputError("residuals_figure got an identification without residual tests; identify from a longer log")
    channels = list(dict.fromkeys(test.channel for test in tests))
    against = list(dict.fromkeys(test.against for test in tests))
    by_place = {(test.channel, test.against): test for test in tests}
    heights = [ROW + BETWEEN] * len(channels)
    wide = (WIDTH - LEFT - RIGHT - ASIDE * (len(against) - 1)) / len(against)
    plant = identification.plant
    with style():
        title = f"{plant.name} ({plant.model}): what is left in the residuals"
        figure, top = sheet(title, header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=LEFT, right=RIGHT)
        header.set_axis_off()
        header.text(
            0, 1, f"correlation over the lag; a right model stays in all grey bands for {100 * LEVEL:g} of 100 logs",
            transform=header.transAxes, va="top", fontsize=8.5,
        )  # fmt: skip
        for column, name in enumerate(against):
            left = LEFT + column * (wide + ASIDE)
            axes = stack(figure, heights, top=top, left=left, right=WIDTH - left - wide, ticks=0.6)
            reach = max(_reach(test) for test in tests if test.against == name)
            for ax, channel in zip(axes, channels, strict=True):
                _lower(ax)
                test = by_place.get((channel, name))
                if test is None:
                    ax.set_axis_off()
                    continue
                _draw(ax, test)
                ax.yaxis.set_major_locator(MaxNLocator(3, symmetric=True, steps=[1, 2, 5, 10]))
                ax.set_ylim(-reach, reach)
                if column == 0:
                    ax.set_ylabel(shown(channel).words)
            axes[-1].set_xlabel("lag (samples)")
            place = (left + wide / 2 - LEFT) / (WIDTH - LEFT - RIGHT)
            header.text(place, 0, f"with {name}", transform=header.transAxes, ha="center", fontweight="bold")
    return figure


def _lower(ax: Axes) -> None:
    """Room above the panel for its words."""
    assert ax.figure is not None
    box, total = ax.get_position(), ax.figure.get_figheight()  # type: ignore[union-attr]
    ax.set_position((box.x0, box.y0, box.width, box.height - BETWEEN / total))


def _reach(test: Correlation) -> float:
    return max(1.15 * test.largest, 2.5 * test.band)


def _draw(ax: Axes, test: Correlation) -> None:
    first = 1 if test.against == "itself" else 0
    lags = np.arange(first, first + test.values.size)
    ax.axhspan(-test.band, test.band, color=GREY, alpha=0.22, linewidth=0, zorder=1)
    ax.axhline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
    outside = np.abs(test.values) > test.band
    for part, colour, width in ((~outside, BLUE, 1.2), (outside, VERMILION, 2.0)):
        ax.vlines(lags[part], 0.0, test.values[part], color=colour, linewidth=width)
    ax.set_xlim(-0.8, lags[-1] + 0.8)
    words = f"{'✓' if test.passed else '✗'} {test.largest:.2g}"
    ax.text(
        1.0, 1.03, words, transform=ax.transAxes, ha="right", va="bottom", fontsize=8,
        fontweight="normal" if test.passed else "bold",
    )  # fmt: skip
