"""Figure of a learnt reference: error of the trials, and of the first and the best one over time."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.plotting import draw
from ...scenario.learning import LearntReference
from ..style import BLUE, GREY, VERMILION
from . import _panels as panel
from ._layout import XLABEL, sheet


@draw.register
def learning_figure(result: LearntReference) -> Figure:
    """RMS and largest error [um] of each trial; error [mm] over time [s] of the first and the best one."""
    title = f"{result.scenario} with {result.controller}: {len(result.trials) - 1} corrections of the reference"
    with sheet(title, [["trials"], ["error"]], [1.5 * panel.PANEL, 1.5 * panel.PANEL], extra=2 * XLABEL) as (fig, axes):
        ax = axes["trials"]
        numbers = [one.number for one in result.trials]
        for key, words, color in (("largest", "largest", GREY), ("rms", "RMS", BLUE)):
            values = [1e6 * getattr(one, key) for one in result.trials]
            ax.plot(numbers, values, color=color, marker="o", markersize=4, label=words)
        ax.set_yscale("log")
        ax.set_ylabel("error (um)")
        ax.set_xlabel("trial")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.legend(loc="upper right", ncols=2)
        ax = axes["error"]
        for number, color in zip(result.errors, (GREY, VERMILION), strict=False):
            words = "without correction" if number == 0 else f"trial {number}"
            look = {"color": color, "linewidth": 1.0, "label": words}
            panel.draw(ax, result.time, 1e3 * result.errors[number], look)
        ax.set_ylabel("error (mm)")
        ax.set_xlabel("time (s)")
        ax.set_xlim(result.time[0], result.time[-1])
        ax.legend(loc="upper right", ncols=2)
    return fig
