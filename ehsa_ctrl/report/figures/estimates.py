"""Estimates of an identification: accuracy, correlation, residuals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter, NullLocator

from ...core.errors import InputError
from ...identification.identification import Identification
from ...identification.residual_tests import LEVEL, Correlation
from ...identification.uncertainty import POOR, TRADES, WELL, Estimate
from ...plant.file import label
from ..signals import channel_display
from ..style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION
from ..text import number
from ._layout import header_legend, share_x, sheet

#: Height of a row of parameters, in.
ROW = 0.27
#: Deviations up to this are drawn on a linear scale, larger ones on a logarithmic one, %.
LINEAR = 1.0
#: Largest start deviation and interval that determine the axis of deviations, and end of wider intervals, %.
FARTHEST, UNKNOWN, BEYOND = 1e5, 200.0, 1e6
#: Smallest and largest standard deviation that the axis shows, %.
SMALLEST, LARGEST = 1e-3, 1e3
#: A verdict's colour and shape.
VERDICTS: dict[str, dict[str, Any]] = {
    "well determined": {"color": GREEN, "marker": "o", "markersize": 6.5},
    "poorly determined": {"color": VERMILION, "marker": "^", "markersize": 7},
    "not identifiable from this log": {"color": PURPLE, "marker": "X", "markersize": 7.5},
}
START: dict[str, Any] = {
    "color": BLACK, "marker": "D", "markersize": 5, "markerfacecolor": "white", "linestyle": "none", "zorder": 2.5,
}  # fmt: skip
#: Blue for minus and brown for plus, equally dark where equally strong: without colour the numbers have the sign.
COLOURS = LinearSegmentedColormap.from_list("correlation", [BLUE, "#ffffff", "#a34800"])
#: Largest width of a cell of the correlation and of all of them, and width of a character of a name, in.
CELL, ALL, CHARACTER = 0.6, 5.6, 0.075


def parameters_figure(identification: Identification) -> Figure:
    """95 % interval and start of each parameter [% from the estimate], and its standard deviation [%].

    Left, linear up to 1 % and logarithmic beyond: start of the search and 95 % interval. Right, logarithmic: standard
    deviations, with shape and colour by verdict, and the bounds of the verdicts.

    Raises InputError if nothing was estimated.
    """
    estimates = identification.estimates
    if not estimates:
        raise InputError("parameters_figure got an identification without parameters; estimate at least one")
    plant = identification.plant
    title = f"{plant.name} ({plant.model}): identified parameters"
    heights = [ROW * (len(estimates) + 0.5)]
    with sheet(title, [["deviation", "spread"]], heights, widths=(1.35, 1.0), header=0.45) as (figure, axes):
        left, right = axes["deviation"], axes["spread"]
        for row, estimate in enumerate(estimates):
            _deviation(left, row, estimate)
            _spread(right, row, estimate)
        _deviation_axis(left, estimates)
        _spread_axis(right)
        left.set_yticks(range(len(estimates)), [_name(estimate) for estimate in estimates])
        right.set_yticks(range(len(estimates)), [""] * len(estimates))
        for ax in (left, right):
            ax.tick_params(axis="y", length=0)
            ax.set_ylim(len(estimates) - 0.25, -0.75)
        verdicts = {estimate.verdict for estimate in estimates}
        handles = [Line2D([], [], label="start", **START)]
        handles.append(Line2D([], [], label="95 % interval", color=GREY, linewidth=3.5, solid_capstyle="butt"))
        handles += [Line2D([], [], label=v, linestyle="none", **look) for v, look in VERDICTS.items() if v in verdicts]
        bounds = f"bounds of the verdicts, {100 * WELL:g} and {100 * POOR:g} %"
        handles.append(Line2D([], [], label=bounds, color=GREY, linestyle=(0, (2, 2)), linewidth=0.9))
        look = {"handlelength": 1.8, "columnspacing": 1.5}
        header_legend(axes["header"], handles, ncols=math.ceil(len(handles) / 2), fontsize=8.5, **look)
    return figure


def _name(estimate: Estimate) -> str:
    name = label(estimate.name).replace(" ", "\n")
    return f"{name}\n(at {estimate.at_bound} bound)" if estimate.at_bound else name


def _deviation(ax: Axes, row: int, estimate: Estimate) -> None:
    """Interval and start, % of the identified value."""
    look = VERDICTS[estimate.verdict]
    half, start = _off(estimate)
    ax.plot([-half, half], [row, row], color=look["color"], linewidth=3.5, solid_capstyle="butt", zorder=2.2)
    ax.plot(0.0, row, marker="|", markersize=9, color=look["color"], zorder=2.3)
    if math.isfinite(start):
        ax.plot(start, row, **START)


def _off(estimate: Estimate) -> tuple[float, float]:
    """Half width of the interval and deviation of the start, % of the value; infinite for an estimate of zero."""
    half = estimate.interval[1] - estimate.value if math.isfinite(estimate.sd) else math.inf
    start = estimate.start - estimate.value
    if estimate.value == 0.0:
        return BEYOND if half else 0.0, math.copysign(math.inf, start) if start else 0.0
    return min(100.0 * half / abs(estimate.value), BEYOND), 100.0 * start / abs(estimate.value)


def _spread(ax: Axes, row: int, estimate: Estimate) -> None:
    """Standard deviation, % of the value, as marker and number."""
    look = VERDICTS[estimate.verdict]
    percent = 100.0 * estimate.relative_sd
    place = min(max(percent, SMALLEST), LARGEST)
    ax.plot([SMALLEST, place], [row, row], color=look["color"], linewidth=1.2, zorder=2.2)
    edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.6, "clip_on": False}
    ax.plot(place, row, linestyle="none", zorder=2.4, **edge, **look)
    words = f"{percent:.2g} %" if percent <= LARGEST else ("unbounded" if math.isinf(estimate.sd) else "> 1000 %")
    ax.text(1.045, row, words, transform=ax.get_yaxis_transform(), va="center", fontsize=8)


def _deviation_axis(ax: Axes, estimates: Iterable[Estimate]) -> None:
    """Set a range that contains the starts; very wide intervals may exceed it."""
    ax.set_xscale("symlog", linthresh=LINEAR, linscale=0.6)
    off = [(half, abs(start)) for half, start in map(_off, estimates)]
    farthest = [10.0, *(start for _, start in off if start < FARTHEST), *(half for half, _ in off if half < UNKNOWN)]
    end = 1.6 * max(farthest)
    ax.set_xlim(-end, end)
    decades = math.floor(math.log10(end))
    steps = [10.0**power for power in range(0, decades + 1, 1 if decades < 3 else 2)]
    ax.set_xticks([*(-step for step in reversed(steps)), 0.0, *steps])
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value).replace("-", "−")))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.axvline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
    ax.set_xlabel("deviation from the identified value (%)")


def _spread_axis(ax: Axes) -> None:
    ax.set_xscale("log")
    ax.set_xlim(SMALLEST, LARGEST)
    ax.set_xticks([0.001, 0.01, 0.1, 1, 10, 100, 1000], ["", "0.01", "0.1", "1", "10", "100", ""])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_minor_formatter(NullFormatter())
    for bound in (WELL, POOR):
        ax.axvline(100.0 * bound, color=GREY, linestyle=(0, (2, 2)), linewidth=0.9, zorder=1.5)
    ax.set_xlabel("standard deviation (% of the value)")


def correlation_figure(identification: Identification) -> Figure:
    """Correlation of each pair of estimates, as a triangle of coloured cells with numbers.

    A frame marks a pair beyond +-0.9: the logs determine the sum or ratio of the two better than each. A dash marks
    parameters that the logs do not determine, and all parameters if they were estimated from balances.

    Raises InputError if nothing was estimated.
    """
    found = identification.uncertainty
    count = len(found.names)
    if not count:
        raise InputError("correlation_figure got an identification without parameters; estimate at least one")
    matrix = found.correlation
    # Balances are solved one after the other, so the correlation of their errors is unknown.
    blind = ~np.isfinite(found.sd) | (found.sd <= 0.0) | (identification.method == "balances")
    cell = min(CELL, ALL / count)
    names = list(map(label, found.names))
    plant = identification.plant
    note = f"framed: beyond ±{TRADES:g}, the two parameters compensate each other"
    title = f"{plant.name} ({plant.model}): correlation of the estimates"
    turned = 0.75 * CHARACTER * max(map(len, names)) + 0.1
    with sheet(title, [["cells"]], [count * cell], header=0.1, notes=[note], extra=turned) as (figure, axes):
        ax = axes["cells"]
        ax.grid(visible=False)
        lower = np.where(np.tri(count, k=-1, dtype=bool) & ~(blind[:, None] | blind[None, :]), matrix, np.nan)
        edges = np.arange(count + 1)
        ax.pcolormesh(edges, edges, np.ma.masked_invalid(lower), cmap=COLOURS, vmin=-1.0, vmax=1.0)
        for row in range(count):
            ax.add_patch(Rectangle((row, row), 1, 1, facecolor="#e4e4e4", edgecolor="none"))
            for column in range(row):
                _cell(ax, row, column, float(lower[row, column]), min(8.0, 15.0 * cell))
        centres = edges[:-1] + 0.5
        ax.set_xticks(centres, names, rotation=45, ha="right", rotation_mode="anchor")
        ax.set_yticks(centres, names)
        ax.tick_params(length=0)
        ax.set_xlim(0, count)
        ax.set_ylim(count, 0)
        ax.set_aspect("equal", anchor="W")
        for side in ax.spines.values():
            side.set_visible(False)
    return figure


def _cell(ax: Axes, row: int, column: int, value: float, size: float) -> None:
    """Write the number in its cell, with a frame around a strong correlation."""
    # Rounded first, to avoid a negative zero.
    words = "–" if np.isnan(value) else f"{round(value, 2) + 0.0:.2f}".replace("-", "−")
    ink = "white" if abs(value) > 0.78 else BLACK
    ax.text(column + 0.5, row + 0.5, words, ha="center", va="center", fontsize=size, color=ink)
    if abs(value) > TRADES:
        frame = Rectangle((column + 0.05, row + 0.05), 0.9, 0.9, fill=False, linewidth=2.2, edgecolor=BLACK)
        ax.add_patch(frame)


def residuals_figure(identification: Identification) -> Figure:
    """Correlation of each channel's whitened residual with itself, the drive, sign(v) and x over the lag [samples].

    One row per channel, one column per signal that it is correlated with. For 99 of 100 logs, a correct model stays in
    the bands at all lags of all panels; values outside are highlighted, and above each panel is the largest value.

    Raises InputError if there are no residual tests.
    """
    tests = identification.residual_tests
    if not tests:
        raise InputError("residuals_figure got an identification without residual tests; identify from a longer log")
    channels = list(dict.fromkeys(test.channel for test in tests))
    against = list(dict.fromkeys(test.against for test in tests))
    by_place = {(test.channel, test.against): test for test in tests}
    rows = [[f"{channel} {name}" for name in against] for channel in channels]
    plant = identification.plant
    note = f"correlation over the lag; a correct model stays in all grey bands for {100 * LEVEL:g} of 100 logs"
    title = f"{plant.name} ({plant.model}): correlation of the residuals"
    with sheet(title, rows, [1.0] * len(rows), header=0.1, notes=[note], extra=0.7 + 0.2 * len(rows)) as (figure, axes):
        for column, name in enumerate(against):
            panels = [axes[row[column]] for row in rows]
            share_x(panels)
            panels[0].set_title(f"with {name}", fontweight="bold", pad=14)
            reach = max(max(1.15 * test.largest, 2.5 * test.band) for test in tests if test.against == name)
            for ax, channel in zip(panels, channels, strict=True):
                test = by_place.get((channel, name))
                if test is None:
                    ax.set_axis_off()
                    continue
                _correlation(ax, test)
                ax.yaxis.set_major_locator(MaxNLocator(3, symmetric=True, steps=[1, 2, 5, 10]))
                ax.set_ylim(-reach, reach)
                if column == 0:
                    ax.set_ylabel(channel_display(channel).words)
            panels[-1].set_xlabel("lag (samples)")
    return figure


def _correlation(ax: Axes, test: Correlation) -> None:
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
