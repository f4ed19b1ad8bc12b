"""Steps of a linear loop."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...design.analysis.closed_loop import StepResponse
from ..style import BLACK, BLUE, SIGNALS, WIDTH, style
from . import _panels as panel
from ._layout import sheet, stack

#: What is stepped: 1 mm of reference, 1 kN of force.
SIZES = {"reference": 1e-3, "force": 1e3}
TITLES = {"reference": "reference 1 mm", "force": "force on the rod 1 kN"}
HEIGHTS = [1.8, 1.5]


def step_figure(steps: StepResponse) -> Figure:
    """Position [mm] and current [A] over time [s]: left after 1 mm of reference, right after 1 kN on the rod."""
    with style():
        title = f"Linear loop with {steps.controller}: steps of reference and force, no limit, no friction"
        figure, top = sheet(title, header=0.25, heights=HEIGHTS)
        columns = {
            "reference": stack(figure, HEIGHTS, top=top, left=0.85, right=WIDTH / 2 - 0.05, ticks=0.5),
            "force": stack(figure, HEIGHTS, top=top, left=WIDTH / 2 + 0.55, right=0.15, ticks=0.5),
        }
        for name, axes in columns.items():
            axes[0].set_title(TITLES[name], fontsize=9)
            for ax, signal, values in zip(axes, ("x", "current"), (steps.position, steps.current), strict=True):
                _draw(ax, steps.time, SIGNALS[signal].read(SIZES[name] * values[name]), stepwise=signal == "current")
                panel.fit(ax, SIGNALS[signal])
                if name == "force":
                    ax.set_ylabel("")
            axes[-1].set_xlim(steps.time[0], steps.time[-1])
            axes[-1].set_xlabel("time (s)")
        columns["reference"][0].axhline(1.0, color=BLACK, linewidth=0.7, linestyle=(0, (6, 3)), zorder=1.5)
    return figure


def _draw(ax: Axes, time: np.ndarray, values: np.ndarray, *, stepwise: bool) -> None:
    ax.plot(time, values, color=BLUE, linewidth=1.3, drawstyle="steps-post" if stepwise else "default")
