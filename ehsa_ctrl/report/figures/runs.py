"""Simulated runs over time: one run, a scenario, a run with its baseline, one loop on two plants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.errors import InputError
from ...core.plotting import draw
from ...scenario.baseline import recorded_of
from ...scenario.result import ScenarioResult
from ...simulation.closed_loop import ClosedLoop
from ...simulation.trajectory import Trajectory
from ..closed_loop import plant_title
from ..signals import SIGNALS, Signal, drive_signal, state_signal
from ..style import GREY, PRESSURES, PURPLE, ROLES, SKY
from . import _panels as panel
from ._layout import header_legend

#: The two runs of a scenario.
LABELS = {"linear": "linear prediction", "nonlinear": "nonlinear plant"}
HELD: dict[str, Any] = {"drawstyle": "steps-post"}


@draw.register
def trajectory_figure(run: Trajectory) -> Figure:
    """Current [A], speed [rpm], both pressures [bar] and position [mm] over time [s].

    For the nonlinear model a strip shows when shaft and rod stick; the external force [kN] has a panel if there is
    one. Limits of the plant that the run exceeded are lines, with a cross at the first sample beyond. A system other
    than the EHSA has a panel for each input and state.
    """
    if run.plant.structure.system_name != "ehsa":
        return _states_figure(run)
    names = ["current", "omega", "pressures", "x"] + (["force"] if run.outer_force.any() else [])
    # The linear model has no dry friction, so that nothing sticks.
    nonlinear = run.plant.model == "nonlinear"
    contacts = [contact.name for contact in run.plant.structure.system.contacts] if nonlinear else []
    heights = dict.fromkeys(names, panel.PANEL) | ({"strip": panel.ROW * len(contacts)} if contacts else {})
    # A single model needs no dashes, which only distinguish overlaid models.
    look = {"color": ROLES[run.plant.model]["color"], "linewidth": 1.2, "label": f"{run.plant.model} model"}
    held = HELD if run.hold == "zero_order" else {}
    signals = {"force": run.outer_force} | {name: run[name] for name in ("current", "omega", "x")}
    with panel.column(f"{run.plant.name}: simulated run", heights, panel.exceeded_words(run.exceeded)) as (
        figure,
        axes,
    ):
        places = {name: axes[name] for name in names}
        for name in names:
            if name != "pressures":
                stepwise = held if name in ("current", "force") else {}
                line = panel.draw(places[name], run.time, SIGNALS[name].read(signals[name]), look | stepwise)
        axes["x"].set_xlim(run.time[0], run.time[-1])
        _finish(places, run, _pressures(places["pressures"], run))
        if contacts:
            stuck = {f"{name} sticks": (panel.phases(run.time, run.sticks(name)), panel.STUCK) for name in contacts}
            panel.strip(axes["strip"], stuck)
        header_legend(axes["header"], [line])
    return figure


def _states_figure(run: Trajectory) -> Figure:
    """Each input that is not zero throughout and each state over time [s], by their names."""
    system = run.plant.structure.system
    signals = {name: state_signal(name, si) for name, si in run.shown()["signals"].items()}
    names = list(signals)
    heights = dict.fromkeys(names, panel.PANEL) | {"strip": panel.ROW * len(system.contacts)}
    with panel.column(f"{run.plant.name}: simulated run", heights) as (figure, axes):
        for name in names:
            stepwise = HELD if name in system.inputs and run.hold == "zero_order" else {}
            look = {"color": ROLES[run.plant.model]["color"], "linewidth": 1.2} | stepwise
            panel.draw(axes[name], run.time, signals[name].read(run[name]), look)
            panel.set_range(axes[name], signals[name])
        axes[names[0]].set_xlim(run.time[0], run.time[-1])
        stuck = {c.name: (panel.phases(run.time, run.sticks(c.name)), panel.STUCK) for c in system.contacts}
        panel.strip(axes["strip"], {f"{name} sticks": bars for name, bars in stuck.items()})
    return figure


def _drive(run: Trajectory) -> Signal:
    """The drive of a run as a signal."""
    system = run.plant.structure.system
    return drive_signal(system.drive, system.drive_unit)


def _pressures(ax: Axes, run: Trajectory) -> list[Artist]:
    return [panel.draw(ax, run.time, SIGNALS["pressures"].read(run[name]), look) for name, look in PRESSURES.items()]


def _finish(places: Mapping[str, Axes], run: Trajectory, pressures: list[Artist]) -> None:
    """Exceeded limits, labels and ranges, and legends beside the panels."""
    limits = panel.exceeded_limits(places, run)
    for name, ax in places.items():
        panel.set_range(ax, _drive(run) if name == "current" else SIGNALS[name])
        panel.panel_legend(ax, (pressures if name == "pressures" else []) + limits[name])


@draw.register
def _(result: ScenarioResult, view: str = "run") -> Figure:
    return baseline_figure(result) if view == "baseline" else scenario_figure(result)


def scenario_figure(result: ScenarioResult) -> Figure:
    """Position [mm] with reference, error [mm], speed [rpm], pressure difference [bar] and current [A] over time [s].

    With a force target also the force between rod and load [kN] with its target. Each for the linear prediction and the
    nonlinear plant; the two chamber pressures [bar] are those of the nonlinear plant. Strips show when its rod sticks
    and when an external force acts, which also tints the panels. Limits of the plant that the nonlinear run exceeded
    are lines, with a cross at the first sample beyond.
    """
    run = result.nonlinear.trajectory
    forces = panel.levels(run.time, run.outer_force)
    rows = {"rod sticks": (panel.phases(run.time, run.sticks("rod")), panel.STUCK)}
    if forces:
        rows["force on rod"] = (forces, panel.FORCE)
    heights = {"x": 1.4 * panel.PANEL, "strip": panel.ROW * len(rows)}
    hydraulic = bool(run.plant.structure.system.pressures)
    others = ("omega", "dP") if hydraulic else ("v",)
    target_force = result.nonlinear.force_reference
    if target_force is not None:
        heights["force"] = 1.4 * panel.PANEL
    heights |= dict.fromkeys(("error", *others, *(("pressures",) if hydraulic else ()), "current"), panel.PANEL)
    verdict = {"pass": "passed", "fail": "FAILED", "untested": "untested"}[result.verdict]
    title = f"{result.scenario.title}\n{result.scenario.name} with {result.controller.name}: {verdict}"
    with panel.column(title, heights, panel.exceeded_words(result.trips, result.expected_trips)) as (figure, axes):
        places = {name: axes[name] for name in heights if name != "strip"}
        target = SIGNALS["x"].read(result.nonlinear.reference[:, 0])
        lines = [panel.draw(places["x"], run.time, target, ROLES["reference"] | HELD)]
        if target_force is not None:
            panel.draw(places["force"], run.time, SIGNALS["force"].read(target_force), ROLES["reference"])
        for role, loop in (("linear", result.linear), ("nonlinear", result.nonlinear)):
            if target_force is not None:
                shown = SIGNALS["force"].read(loop.trajectory.cell_force)
                panel.draw(places["force"], run.time, shown, ROLES[role])
            lines.append(_loop(places, loop, ROLES[role] | {"label": LABELS[role]}, others))
        axes["strip"].set_xlim(run.time[0], run.time[-1])
        _finish(places, run, _pressures(places["pressures"], run) if hydraulic else [])
        places["error"].axhline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
        limit = float(getattr(result.controller, "current_limit", np.inf))
        for edge in (limit, -limit):
            if np.any(np.sign(edge) * result.nonlinear.asked >= limit * (1 - 1e-9)):
                places["current"].axhline(edge, color=GREY, linestyle=(0, (2, 2)), linewidth=1.0)
        panel.strip(axes["strip"], rows)
        panel.shade(places.values(), forces)
        header_legend(axes["header"], lines)
    return figure


def _loop(places: Mapping[str, Axes], loop: ClosedLoop, look: dict[str, Any], others: tuple[str, ...]) -> Artist:
    """Position, error, current and other signals of a closed loop; returns the line of the position."""
    run = loop.trajectory
    for name in others:
        panel.draw(places[name], run.time, SIGNALS[name].read(run[name]), look)
    panel.draw(places["error"], run.time, SIGNALS["error"].read(loop.error), look)
    # Thinner lines, as sensor noise turns the current into a broad band.
    thin = look | {"linewidth": 0.7 * look["linewidth"]} | HELD
    panel.draw(places["current"], run.time, _drive(run).read(run.current), thin)
    return panel.draw(places["x"], run.time, SIGNALS["x"].read(run["x"]), look)


def baseline_figure(result: ScenarioResult) -> Figure:
    """Position [mm], speed [rpm] and pressure difference [bar] over time [s]: the recorded run's tube, and this run.

    Samples outside the tube are marked. Raises InputError for a run without a baseline.
    """
    if result.baseline is None:
        raise InputError(f"{result.scenario.name} with {result.controller.name} has no baseline; record it first")
    run = result.nonlinear.trajectory
    title = f"{result.scenario.title}\n{result.scenario.name} with {result.controller.name} and its baseline"
    with panel.column(title, dict.fromkeys(recorded_of(run), panel.PANEL)) as (figure, axes):
        for name in recorded_of(run):
            ax, read = axes[name], SIGNALS[name].read
            bounds = result.baseline.tube(result, name)
            tube = ax.fill_between(
                run.time, read(bounds.lower), read(bounds.upper), color=SKY, alpha=0.4, linewidth=0, label="tube"
            )
            now = panel.draw(ax, run.time, read(run[name]), ROLES["nonlinear"] | {"label": "this run"})
            beyond = (run[name] > bounds.upper) | (run[name] < bounds.lower)
            ax.plot(run.time[beyond], read(run[name][beyond]), ".", color=PURPLE, markersize=4, zorder=3)
            panel.set_range(ax, SIGNALS[name])
        header_legend(axes["header"], [tube, now])
    return figure


def closed_figure(loops: Mapping[str, ClosedLoop], title: str) -> Figure:
    """Position [mm] with reference, error [mm] and current [A] over time [s] of one or two runs of the same loop.

    A strip for each shows when its rod sticks.

    Parameters
    ----------
    loops: name of each plant -> its run; the first is drawn as "before", the second as "after".

    Raises InputError unless there are one or two runs.
    """
    if not 1 <= len(loops) <= 2:
        raise InputError(f"closed_figure got {len(loops)} runs; expected one or two")
    heights = {"x": 1.4 * panel.PANEL, "strip": panel.ROW * len(loops), "error": panel.PANEL, "current": panel.PANEL}
    first = next(iter(loops.values()))
    time = first.trajectory.time
    with panel.column(title, heights) as (figure, axes):
        places = {name: axes[name] for name in ("x", "error", "current")}
        reference = SIGNALS["x"].read(first.reference[:, 0])
        lines: list[Artist] = [panel.draw(places["x"], time, reference, ROLES["reference"] | HELD)]
        rows = {}
        for role, (word, loop) in zip(("before", "after"), loops.items(), strict=False):
            look = ROLES[role] | {"label": plant_title(word)}
            lines.append(_loop(places, loop, look, ()))
            stuck = panel.phases(loop.trajectory.time, loop.trajectory.sticks("rod"))
            rows[f"{plant_title(word)}: rod sticks"] = (stuck, look["color"])
        axes["strip"].set_xlim(time[0], time[-1])
        for name, ax in places.items():
            panel.set_range(ax, _drive(first.trajectory) if name == "current" else SIGNALS[name])
        places["error"].axhline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
        panel.strip(axes["strip"], rows)
        header_legend(axes["header"], lines)
    return figure
