"""A proposed input with its expected accuracy."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.plotting import draw
from ...identification.experiment import ExperimentDesign
from ...identification.uncertainty import POOR, WELL
from ...plant.file import label
from ..signals import SIGNALS, state_signal
from ..style import BLUE, GREY, LIMIT, PRESSURES, PURPLE, ROLES
from ..text import number
from . import _panels as panel
from ._layout import XLABEL, header_legend, share_x, sheet

#: Height of a bar, in; smallest relative standard deviation that the axis shows, %.
BAR, SMALLEST = 0.21, 1e-3


@draw.register
def experiment_figure(experiment: ExperimentDesign) -> Figure:
    """Current [A], speed [rpm], pressures [bar] and position [mm] over time [s], and the expected sd [%] of each
    parameter: bars for the nominal plant, ticks for the worst of its variations.

    Of a system without chambers the drive and all states.
    """
    run = experiment.run
    look = {"color": ROLES[run.plant.model]["color"], "linewidth": 1.2, "label": f"nominal {run.plant.model} model"}
    relative = experiment.forecast.relative
    system = run.plant.structure.system
    names = ["current", "omega", "pressures", "x"] if system.pressures else list(run.shown()["signals"])
    signals = SIGNALS if system.pressures else {name: state_signal(name, run.units[name]) for name in names}
    heights = [*[panel.PANEL] * len(names), BAR * len(relative)]
    title = f"{run.plant.name}: {experiment.chosen.words}" + (", with the slow loop" if experiment.centre else "")
    rows = [[name] for name in (*names, "spread")]
    with sheet(title, rows, heights, header=0.25, extra=2 * XLABEL) as (figure, axes):
        for name in names:
            ax = axes[name]
            if name == "pressures":
                read = SIGNALS[name].read
                panel.panel_legend(ax, [panel.draw(ax, run.time, read(run[p]), how) for p, how in PRESSURES.items()])
            else:
                held = {"drawstyle": "steps-post"} if name == "current" else {}
                line = panel.draw(ax, run.time, signals[name].read(run[name]), look | held)
            panel.set_range(ax, signals[name])
        share_x([axes[name] for name in names])
        axes[names[-1]].set_xlim(run.time[0], run.time[-1])
        axes[names[-1]].set_xlabel("time (s)")
        header_legend(axes["header"], [line])
        _accuracy(axes["spread"], relative, dict(experiment.at_worst) if experiment.draws else {})
    return figure


def _accuracy(ax: Axes, relative: dict[str, float], worst: dict[str, float]) -> None:
    """Relative sd [%] of each parameter on a logarithmic axis; an empty bar for an undetermined one."""
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
    ax.set_yticks(range(len(relative)), [label(name).replace(" ", "\n") for name in relative])
    ax.set_ylim(len(relative) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("expected standard deviation (% of the value); tick: at worst; dashed: well and poorly determined")
