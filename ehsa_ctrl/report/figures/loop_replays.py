"""A closed-loop replay: what the models leave of the position and of the drive over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ...core.errors import InputError
from ...diagnosis.closed_loop_replay import ClosedLoopReplay
from ...diagnosis.diagnosis import Diagnosis
from ..outcome import after_model
from ..signals import channel_display
from ..style import GREY, ROLES
from . import _panels as panel
from ._layout import header_legend
from .free_runs import HELD_OUT

if TYPE_CHECKING:
    import pandas


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
    shown, of_drive = channel_display(position), channel_display(drive)
    table = loop_replay_table(diagnosis, loop)
    heights = {"error": 1.4 * panel.PANEL, "drive": panel.PANEL}
    with panel.column(f"Closed-loop replay with {loop.controller}", heights) as (figure, axes):
        lines = [panel.draw(axes["drive"], loop.time, table[drive].to_numpy() / of_drive.scale, ROLES["measured"])]
        errors = []
        for role in [role for role in ("before", "after") if f"error_{role}" in table]:
            errors.append(table[f"error_{role}"].to_numpy() / shown.scale)
            panel.draw(axes["error"], loop.time, errors[-1], ROLES[role])
            simulated = table[f"{drive}_{role}"].to_numpy() / of_drive.scale
            lines.append(panel.draw(axes["drive"], loop.time, simulated, ROLES[role]))
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


def loop_replay_table(diagnosis: Diagnosis, loop: ClosedLoopReplay) -> pandas.DataFrame:
    """Position and drive in closed loop, SI units: measured, before (nominal) and after; nan where a run ended
    early.

    Columns: t, NAME, NAME_before, NAME_after; error_before and error_after, measured minus simulated position.
    """
    import pandas

    system = diagnosis.plant.structure.system
    position, drive = next(iter(system.positions)), system.drive
    after = after_model(diagnosis.verdict, loop.gap)
    runs = {"before": loop.simulated["nominal"]} | ({"after": loop.simulated[after]} if after else {})
    columns = {"t": loop.time}
    for name, key in ((position, position), (drive, "drive")):
        columns[name] = loop.measured[key]
        for role, run in runs.items():
            columns[f"{name}_{role}"] = np.full(loop.time.size, np.nan)
            n = min(run[key].size, loop.time.size)
            columns[f"{name}_{role}"][:n] = run[key][:n]
    columns |= {f"error_{role}": columns[position] - columns[f"{position}_{role}"] for role in runs}
    return pandas.DataFrame(columns)
