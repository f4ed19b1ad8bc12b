"""A scenario: what the linear model promised and what the nonlinear plant did."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.plotting import draw
from ...scenario.result import ScenarioResult
from ..style import GREY, PRESSURES, ROLES, SIGNALS, style
from . import _panels as panel
from .baseline import baseline_figure

#: The two runs, as their lines are named.
LABELS = {"linear": "linear prediction", "nonlinear": "nonlinear plant"}
PANELS = ("x", "strip", "error", "omega", "dP", "pressures", "current")


def scenario_figure(result: ScenarioResult) -> Figure:
    """Position [mm] with reference, error [mm], speed [rpm], pressure difference [bar] and current [A] over time [s].

    Each for the linear prediction and the nonlinear plant; the two chamber pressures [bar] are those of the nonlinear
    plant. Strips show when its rod sticks and when a force from outside acts, which also tints the panels. Limits of
    the plant that the nonlinear run passed are lines, with a cross at the first sample beyond.
    """
    run = result.nonlinear.trajectory
    forces = panel.levels(run.time, run.outer_force)
    rows = {"rod sticks": (panel.phases(run.time, run.sticks("rod")), panel.STUCK)}
    if forces:
        rows["force on rod"] = (forces, panel.FORCE)
    heights = [panel.PANEL] * len(PANELS)
    heights[PANELS.index("x")] *= 1.4
    heights[PANELS.index("strip")] = panel.ROW * len(rows)
    verdict = {"pass": "passed", "fail": "FAILED", "untested": "untested"}[result.verdict]
    title = f"{result.scenario.title}\n{result.scenario.name} with {result.controller.name}: {verdict}"
    words = panel.passed_words(result.trips, result.expected_trips)
    with style():
        figure, header, axes = panel.column(heights, title, notes=words, right=panel.beside_width(run))
        places = dict(zip(PANELS, axes, strict=True))
        strip = places.pop("strip")
        target = SIGNALS["x"].read(result.nonlinear.reference[:, 0])
        lines = [panel.draw(places["x"], run.time, target, ROLES["reference"] | {"drawstyle": "steps-post"})]
        for role, loop in (("linear", result.linear), ("nonlinear", result.nonlinear)):
            how = ROLES[role] | {"label": LABELS[role]}
            values = {"error": loop.error} | {name: loop.trajectory[name] for name in ("omega", "dP", "x")}
            for name, signal in values.items():
                line = panel.draw(places[name], run.time, SIGNALS[name].read(signal), how)
            lines.append(line)
            # Thinner: what the sensors' noise does to the current would be a broad band.
            thin = how | {"linewidth": 0.7 * how["linewidth"], "drawstyle": "steps-post"}
            panel.draw(places["current"], run.time, SIGNALS["current"].read(loop.trajectory.current), thin)
        pressures = [
            panel.draw(places["pressures"], run.time, SIGNALS["pressures"].read(run[symbol]), line)
            for symbol, line in PRESSURES.items()
        ]
        strip.set_xlim(run.time[0], run.time[-1])
        limits = panel.passed_limits(places, run)
        for name, ax in places.items():
            panel.fit(ax, SIGNALS[name])
            panel.beside(ax, (pressures if name == "pressures" else []) + limits[name])
        places["error"].axhline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
        _current_limit(result, places["current"])
        panel.strip(strip, rows)
        panel.shade(places.values(), forces)
        panel.legend(header, lines)
    return figure


def _current_limit(result: ScenarioResult, ax: Axes) -> None:
    """The controller's own limit, where the nonlinear run reached it."""
    limit = float(getattr(result.controller, "current_limit", np.inf))
    for edge in (limit, -limit):
        if np.any(np.sign(edge) * result.nonlinear.asked >= limit * (1 - 1e-9)):
            ax.axhline(edge, color=GREY, linestyle=(0, (2, 2)), linewidth=1.0)


@draw.register
def _(result: ScenarioResult, view: str = "run") -> Figure:
    return baseline_figure(result) if view == "baseline" else scenario_figure(result)
