"""A Monte Carlo campaign: where in its range a parameter lets the scenario pass."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...core.plotting import draw
from ...plant.file import both
from ...scenario.montecarlo import MonteCarlo
from ..number import number, unit
from ..style import BLUE, GREY, VERMILION, style
from ._layout import GAP, sheet, stack

#: Parameters that are shown, the most decisive ones; bins of each.
SHOWN, BINS = 4, 20
#: Height of a panel and of what stands below it, in.
PANEL, BELOW = 1.3, 0.45


@draw.register
def montecarlo_figure(result: MonteCarlo) -> Figure:
    """Share of runs that pass over each decisive parameter, with how many runs lie in each part of its range.

    Bars: runs (left axis), those that pass in blue, the others in vermilion on top. Parameters in SI units.
    """
    low, high = result.interval()
    title = (
        f"{result.scenario} with {result.controller}\n{result.passes} of {len(result.outcomes)} runs pass: probability "
        f"{number(result.probability)} (95 %: {number(low)} to {number(high)})"
    )
    chosen = result.influences[:SHOWN]
    units = {parameter.name: parameter.unit for parameter in result.uncertainty.parameters}
    count = max(len(chosen), 1)
    with style():
        figure, top = sheet(title, header=GAP, heights=[PANEL + BELOW] * count)
        # Each has an axis of its own below.
        places = [top + k * (PANEL + BELOW + GAP) for k in range(count)]
        axes = [stack(figure, [PANEL], top=place, left=0.9, right=0.15)[0] for place in places]
        passed = np.array([outcome.passed for outcome in result.outcomes], dtype=bool)
        for ax, influence in zip(axes, chosen, strict=False):
            values = np.array([outcome.parameters[influence.name] for outcome in result.outcomes])
            edges = np.histogram_bin_edges(values, BINS)
            counts = [np.histogram(values[which], edges)[0] for which in (passed, ~passed)]
            how: dict[str, Any] = {"width": np.diff(edges), "align": "edge", "edgecolor": "white", "linewidth": 0.4}
            ax.bar(edges[:-1], counts[0], color=BLUE, label="pass", **how)
            ax.bar(edges[:-1], counts[1], bottom=counts[0], color=VERMILION, hatch="///", label="fail", **how)
            words = unit(units[influence.name])
            ax.set_xlabel(f"{both(influence.name)}, {words} ({'decisive' if influence.decisive else 'not decisive'})")
            ax.set_ylabel("runs")
            ax.set_xlim(edges[0], edges[-1])
        if chosen:
            axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
        else:
            axes[0].text(0.5, 0.5, "nothing was uncertain but the sensors' noise", ha="center", color=GREY)
    return figure
