"""A Monte Carlo campaign: margins to the limits over the parameters that decide them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.plotting import draw
from ...plant.file import label
from ...scenario.montecarlo import MonteCarlo
from ..style import BLACK, BLUE, GREY, LIMIT, RASTER_POINTS, VERMILION
from ..text import SUPERSCRIPTS, number, unit
from ._layout import XLABEL, header_legend, share_x, sheet

#: Limits and parameters that are shown at most: the nearest to violation and the most influential.
LIMITS, PARAMETERS = 3, 3
#: Height of a panel, in. Margins below `LOWEST` [%] are drawn as triangles at the bottom, which one run far off or
#: without a value would otherwise set the scale of.
PANEL, LOWEST = 1.75, -150.0
#: Looks of passing and failing runs, apart in black and white too.
PASS: dict[str, Any] = {"color": BLUE, "marker": "o", "markersize": 3.2, "markeredgewidth": 0, "alpha": 0.6}
FAIL: dict[str, Any] = {"color": VERMILION, "marker": "x", "markersize": 5, "markeredgewidth": 1.2}


@draw.register
def montecarlo_figure(result: MonteCarlo) -> Figure:
    """Margin [% of the limit] of each run over each of the most influential parameters, SI units.

    Rows: the limits nearest to violation. Columns: parameters. Dots: runs that pass; crosses: runs that fail, whichever
    of their limits they violate. The worst run has a ring and its number.
    """
    low, high = result.interval()
    title = (
        f"{result.scenario} with {result.controller}\n{result.passes} of {len(result.outcomes)} runs pass: probability "
        f"{number(result.probability)} (95 %: {number(low)} to {number(high)})"
    )
    names = [influence.name for influence in result.influences[:PARAMETERS]]
    margins = dict(list(result.margins.items())[:LIMITS]) or {"": np.array([o.margin for o in result.outcomes])}
    decisive = {influence.name for influence in result.influences if influence.decisive}
    mosaic = [[f"{metric} {name}" for name in names or ["run"]] for metric in margins]
    with sheet(title, mosaic, [PANEL] * len(margins), header=0.25, extra=XLABEL + 0.2) as (figure, axes):
        for (metric, values), row in zip(margins.items(), mosaic, strict=True):
            for place, name in zip(row, names or ["run"], strict=True):
                across, words = _across(result, name)
                _points(axes[place], result, across, 100.0 * values)
                axes[place].set_xlabel(words + ("" if name in decisive or not names else "\nnot decisive"))
            axes[row[0]].set_ylabel(f"{metric or 'smallest'}\nmargin (% of limit)")
            for place in row[1:]:
                axes[place].sharey(axes[row[0]])
                axes[place].tick_params(labelleft=False)
        for column in zip(*mosaic, strict=True):
            share_x([axes[place] for place in column])
            axes[column[-1]].xaxis.set_major_locator(MaxNLocator(4))
            for place in column[:-1]:
                axes[place].set_xlabel("")
        marks = axes[mosaic[0][0]].plot([], [], linestyle="none", label="run that passes", **PASS)
        marks += axes[mosaic[0][0]].plot([], [], linestyle="none", label="run that fails", **FAIL)
        marks += axes[mosaic[0][0]].plot([], [], label="limit", **LIMIT)
        header_legend(axes["header"], marks)
    return figure


def _points(ax: Axes, result: MonteCarlo, across: np.ndarray, margins: np.ndarray) -> None:
    """Runs over one parameter (N,), margins (N,) [%]; those below the panel as triangles at its bottom."""
    passed = np.array([outcome.passed for outcome in result.outcomes], dtype=bool)
    known = margins[np.isfinite(margins)]
    least = max(float(known.min(initial=0.0)), LOWEST)
    span = max(float(known.max(initial=0.0)) - least, 1.0)
    bottom = least - 0.08 * span
    beyond = margins < bottom
    rasterized = margins.size > RASTER_POINTS // 10
    for which, look in ((passed, PASS), (~passed, FAIL)):
        shown = which & ~beyond
        ax.plot(across[shown], margins[shown], linestyle="none", rasterized=rasterized, **look)
        below = which & beyond
        look = look | {"marker": "v", "markersize": 5, "clip_on": False}
        # An empty line that may leave its panel would upset the layout.
        if below.any():
            ax.plot(across[below], np.full(np.count_nonzero(below), bottom), linestyle="none", **look)
    ax.axhline(0.0, **LIMIT)
    k = next(k for k, outcome in enumerate(result.outcomes) if outcome.run == result.worst.run)
    at = (float(across[k]), max(float(margins[k]), bottom))
    ax.plot(*at, marker="o", markersize=9, markerfacecolor="none", markeredgecolor=BLACK, zorder=3, clip_on=False)
    left = at[0] > (across.min() + across.max()) / 2
    ax.annotate(
        f"run {result.worst.run}", at, xytext=(-7 if left else 7, 4), textcoords="offset points",
        ha="right" if left else "left", va="bottom", fontsize=8, color=BLACK, zorder=3,
    ).set_in_layout(False)  # fmt: skip
    ax.margins(x=0.04)
    ax.set_ylim(bottom, max(float(known.max(initial=0.0)), 0.0) + 0.12 * span)
    ax.axhspan(bottom, 0.0, color=GREY, alpha=0.08, linewidth=0)


def _across(result: MonteCarlo, name: str) -> tuple[np.ndarray, str]:
    """Values (N,) of a drawn parameter with its axis label; the number of the run if nothing but noise was drawn."""
    if name == "run":
        return np.array([float(outcome.run) for outcome in result.outcomes]), "run (only the sensors' noise varies)"
    units = {parameter.name: parameter.unit for parameter in result.uncertainty.parameters}
    values = np.array([outcome.parameters[name] for outcome in result.outcomes])
    # Large and small values by powers of a thousand, which the label names.
    largest = max(float(np.max(np.abs(values))), 1e-300)
    power = 0 if 0.1 <= largest < 1e4 else 3 * math.floor(math.log10(largest) / 3)
    times = f"10{str(power).translate(SUPERSCRIPTS)} " if power else ""
    return values / 10.0**power, f"{label(name)} ({times}{unit(units[name])})"
