"""A closed-loop replay: what the models leave of the position and of the drive over time."""

from __future__ import annotations

from matplotlib.figure import Figure

from ...core.errors import InputError
from ...diagnosis.diagnosis import Diagnosis
from ..outcome import after_model
from ..signals import channel_display
from ..style import GREY, ROLES
from . import _panels as panel
from ._layout import header_legend
from .free_runs import HELD_OUT


def loop_replay_figure(diagnosis: Diagnosis) -> Figure:
    """Measured minus simulated position over time [s], and the drive, before and after, in closed loop.

    Raises InputError for a diagnosis without a closed-loop replay.
    """
    loop = diagnosis.closed_loop
    if loop is None:
        raise InputError(
            "loop_replay_figure got a diagnosis without a closed-loop replay; give one by replay_closed_loop"
        )
    system = diagnosis.plant.structure.system
    position, drive = next(iter(system.positions)), system.drive
    models = {"nominal": "before"} | ({after: "after"} if (after := after_model(diagnosis.verdict, loop.gap)) else {})
    shown = channel_display(position)
    heights = {"error": 1.4 * panel.PANEL, "drive": panel.PANEL}
    with panel.column(f"Closed-loop replay with {loop.controller}", heights) as (figure, axes):
        of_drive = channel_display(drive)
        lines = [panel.draw(axes["drive"], loop.time, loop.measured["drive"] / of_drive.scale, ROLES["measured"])]
        errors = []
        for model, role in models.items():
            run = loop.simulated[model]
            n = min(run[position].size, loop.time.size)
            errors.append((loop.measured[position][:n] - run[position][:n]) / shown.scale)
            panel.draw(axes["error"], loop.time[:n], errors[-1], ROLES[role])
            lines.append(panel.draw(axes["drive"], loop.time[:n], run["drive"][:n] / of_drive.scale, ROLES[role]))
        axes["error"].axhline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
        panel.set_range_around(axes["error"], errors, None)
        axes["error"].set_ylabel(f"{shown.words},\nmeasured − simulated\n({shown.unit})")
        axes["drive"].set_ylabel(of_drive.two_lines)
        axes["drive"].set_xlim(loop.time[0], loop.time[-1])
        for start, stop in diagnosis.held_spans:
            for ax in (axes["error"], axes["drive"]):
                ax.axvspan(start, stop, **HELD_OUT)
        header_legend(axes["header"], lines)
    return figure
