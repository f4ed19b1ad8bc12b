"""How far each parameter moved, and how well the logs determine it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from ...core.errors import InputError
from ...identification.identification import Identification
from ...identification.uncertainty import POOR, WELL, Estimate
from ...plant.file import both
from ..number import number
from ..style import BLACK, GREEN, GREY, PURPLE, VERMILION, WIDTH, style
from ._layout import GAP, sheet, stack

#: Height of a row and of the legend, in.
ROW, HEADER = 0.27, 0.45
#: Deviations up to this are drawn on a linear scale, larger ones on a logarithmic one, %.
LINEAR = 1.0
#: Farthest start and widest interval that the axis of deviations makes room for, and where a wider one is drawn to, %.
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


def parameters_figure(identification: Identification) -> Figure:
    """Each parameter's 95 % interval and start [% off the identified value], and its standard deviation [%].

    Left, linear up to 1 % and logarithmic beyond: where the search began, against the interval that the logs leave.
    Right, logarithmic: standard deviations, by shape and colour of the verdict, with the bounds of the verdicts.

    Raises InputError if nothing was estimated.
    """
    estimates = identification.estimates
    if not estimates:
        raise InputError("parameters_figure got an identification without parameters; estimate at least one")
    heights = [ROW * (len(estimates) + 0.5)]
    plant = identification.plant
    with style():
        title = f"{plant.name} ({plant.model}): identified parameters"
        figure, top = sheet(title, header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=0.15, right=0.15)
        header.set_axis_off()
        (left,) = stack(figure, heights, top=top, left=1.35, right=WIDTH - 4.6)
        (right,) = stack(figure, heights, top=top, left=4.85, right=0.9)
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
        _legend(header, {estimate.verdict for estimate in estimates})
    return figure


def _name(estimate: Estimate) -> str:
    name = both(estimate.name).replace(" ", "\n")
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
    """Half of the interval, and where the start is, % of the value; of zero, as a bias may come out, all is endless."""
    half = estimate.interval[1] - estimate.value if math.isfinite(estimate.sd) else math.inf
    start = estimate.start - estimate.value
    if estimate.value == 0.0:
        return BEYOND if half else 0.0, math.copysign(math.inf, start) if start else 0.0
    return min(100.0 * half / abs(estimate.value), BEYOND), 100.0 * start / abs(estimate.value)


def _spread(ax: Axes, row: int, estimate: Estimate) -> None:
    """Standard deviation, % of the value, in figures too."""
    look = VERDICTS[estimate.verdict]
    percent = 100.0 * estimate.relative_sd
    place = min(max(percent, SMALLEST), LARGEST)
    ax.plot([SMALLEST, place], [row, row], color=look["color"], linewidth=1.2, zorder=2.2)
    edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.6, "clip_on": False}
    ax.plot(place, row, linestyle="none", zorder=2.4, **edge, **look)
    words = f"{percent:.2g} %" if percent <= LARGEST else ("unbounded" if math.isinf(estimate.sd) else "> 1000 %")
    ax.text(1.045, row, words, transform=ax.get_yaxis_transform(), va="center", fontsize=8)


def _deviation_axis(ax: Axes, estimates: Iterable[Estimate]) -> None:
    """As far as the starts are; an interval may run out of it, once it says that nothing is known."""
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
    ax.set_xlabel("off the identified value (%)")


def _spread_axis(ax: Axes) -> None:
    ax.set_xscale("log")
    ax.set_xlim(SMALLEST, LARGEST)
    ax.set_xticks([0.001, 0.01, 0.1, 1, 10, 100, 1000], ["", "0.01", "0.1", "1", "10", "100", ""])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_minor_formatter(NullFormatter())
    for bound in (WELL, POOR):
        ax.axvline(100.0 * bound, color=GREY, linestyle=(0, (2, 2)), linewidth=0.9, zorder=1.5)
    ax.set_xlabel("standard deviation (% of the value)")


def _legend(header: Axes, verdicts: set[str]) -> None:
    handles = [Line2D([], [], label="start", **START)]
    handles.append(Line2D([], [], label="95 % interval", color=GREY, linewidth=3.5, solid_capstyle="butt"))
    handles += [
        Line2D([], [], label=verdict, linestyle="none", **look)
        for verdict, look in VERDICTS.items()
        if verdict in verdicts
    ]
    bounds = f"bounds of the verdicts, {100 * WELL:g} and {100 * POOR:g} %"
    handles.append(Line2D([], [], label=bounds, color=GREY, linestyle=(0, (2, 2)), linewidth=0.9))
    header.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0, 0), ncols=math.ceil(len(handles) / 2), borderaxespad=0.0,
        borderpad=0.0, labelspacing=0.3, handlelength=1.8, columnspacing=1.5, fontsize=8.5,
    )  # fmt: skip
