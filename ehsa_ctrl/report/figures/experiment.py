"""A proposed input, what the believed plant does with it, and what its log will tell."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.plotting import draw
from ...identification.experiment import ExperimentDesign
from ...identification.uncertainty import POOR, WELL
from ...plant.file import both
from ..number import number
from ..style import BLUE, GREY, LIMIT, PRESSURES, PURPLE, ROLES, SIGNALS, style
from . import _panels as panel
from ._layout import GAP, sheet, stack

#: Height of a bar, and what is kept free above the bars for the axis of time, in.
BAR, BETWEEN = 0.21, 0.55
#: Smallest relative standard deviation that the axis shows, %.
SMALLEST = 1e-3


@draw.register
def experiment_figure(experiment: ExperimentDesign) -> Figure:
    """Current [A], speed [rpm], pressures [bar] and position [mm] over time [s], and the expected sd [%] of each
    parameter: bars for the believed plant, ticks for the worst of its variations."""
    run = experiment.run
    how = {"color": ROLES[run.plant.model]["color"], "linewidth": 1.2, "label": f"{run.plant.model} model, as believed"}
    relative = experiment.forecast.relative
    heights = [panel.PANEL] * 4
    bars = BAR * len(relative)
    with style():
        title = f"{run.plant.name}: {experiment.chosen.words}" + (", with the slow loop" if experiment.centre else "")
        figure, top = sheet(title, header=0.25 + GAP, heights=[*heights, BETWEEN, bars])
        (header,) = stack(figure, [0.25], top=top - 0.25 - GAP, left=panel.LEFT, right=panel.SYMBOLS)
        header.set_axis_off()
        axes = stack(figure, heights, top=top, left=panel.LEFT, right=panel.SYMBOLS)
        below = top + sum(heights) + GAP * len(heights) + BETWEEN
        (spread,) = stack(figure, [bars], top=below, left=panel.LEFT, right=panel.SYMBOLS)
        for name, ax in zip(("current", "omega", "pressures", "x"), axes, strict=True):
            if name == "pressures":
                lines = [
                    panel.draw(ax, run.time, SIGNALS[name].read(run[symbol]), line)
                    for symbol, line in PRESSURES.items()
                ]
                panel.beside(ax, lines)
            else:
                held = {"drawstyle": "steps-post"} if name == "current" else {}
                line = panel.draw(ax, run.time, SIGNALS[name].read(run[name]), how | held)
            panel.fit(ax, SIGNALS[name])
        axes[-1].set_xlim(run.time[0], run.time[-1])
        axes[-1].set_xlabel("time (s)")
        panel.legend(header, [line])
        _bars(spread, relative, dict(experiment.at_worst) if experiment.draws else {})
    return figure


def _bars(ax: Axes, relative: dict[str, float], worst: dict[str, float]) -> None:
    """Relative sd of each parameter, %, on a logarithmic axis; one that nothing shows has an empty bar to the end."""
    every = [100 * value for value in (*relative.values(), *worst.values()) if np.isfinite(value) and value > 0.0]
    largest = max([*every, 2 * 100 * POOR]) * 1.5
    smallest = max(min([*every, 1.0]) / 2.0, SMALLEST)
    for row, (name, value) in enumerate(relative.items()):
        shown = np.isfinite(value)
        ax.barh(
            row, 100 * value if shown else largest, height=0.6, left=0.0, color=BLUE if shown else "none",
            edgecolor=BLUE if shown else PURPLE, linewidth=0.8,
        )  # fmt: skip
        words = f"{number(float(f'{100 * value:.2g}'))} %" if shown else "not determined"
        ax.annotate(
            words, (1.0, row), xycoords=("axes fraction", "data"), xytext=(4, 0), textcoords="offset points",
            va="center", fontsize=8,
        )  # fmt: skip
        if np.isfinite(worst.get(name, np.inf)):
            ax.plot(100 * worst[name], row, marker="|", markersize=10, color=GREY, markeredgewidth=1.6)
    ax.set_xscale("log")
    ax.set_xlim(smallest, largest)
    for bound in (WELL, POOR):
        ax.axvline(100 * bound, **LIMIT | {"linestyle": (0, (4, 2)), "linewidth": 0.9})
    ax.set_yticks(range(len(relative)), [both(name).replace(" ", "\n") for name in relative])
    ax.set_ylim(len(relative) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("expected standard deviation (% of the value); tick: at worst; dashed: well and poorly determined")
