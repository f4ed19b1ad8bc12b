"""A run beside the recorded one that it is held against."""

from __future__ import annotations

from matplotlib.figure import Figure

from ...core.errors import InputError
from ...scenario.baseline import SIGNALS as RECORDED
from ...scenario.result import ScenarioResult
from ..style import PURPLE, ROLES, SIGNALS, SKY, style
from . import _panels as panel


def baseline_figure(result: ScenarioResult) -> Figure:
    """Position [mm], speed [rpm] and pressure difference [bar] over time [s]: the recorded run's tube, and this run.

    Where the run lies outside its tube it is marked. Raises InputError for a run without a baseline.
    """
    if result.baseline is None:
        raise InputError(f"{result.scenario.name} with {result.controller.name} has no baseline; record it first")
    run = result.nonlinear.trajectory
    title = f"{result.scenario.title}\n{result.scenario.name} with {result.controller.name} against its baseline"
    with style():
        figure, header, axes = panel.column([panel.PANEL] * len(RECORDED), title, notes=[], right=0.2)
        for ax, name in zip(axes, RECORDED, strict=True):
            read = SIGNALS[name].read
            bounds = result.baseline.tube(result, name)
            ax.fill_between(
                run.time, read(bounds.lower), read(bounds.upper), color=SKY, alpha=0.4, linewidth=0, label="tube"
            )
            now = panel.draw(ax, run.time, read(run[name]), ROLES["nonlinear"] | {"label": "this run"})
            beyond = (run[name] > bounds.upper) | (run[name] < bounds.lower)
            ax.plot(
                run.time[beyond], read(run[name][beyond]), ".", color=PURPLE, markersize=4, zorder=3,
                label="outside its tube",
            )  # fmt: skip
            panel.fit(ax, SIGNALS[name])
        lines = [axes[0].collections[0], now]
        panel.legend(header, lines)
    return figure
