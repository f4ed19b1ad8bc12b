"""A log beside the free runs that it drives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...core.errors import InputError
from ...core.plotting import draw
from ...identification.comparison import Comparison
from ..channel import liveliest, shown
from .overlay import overlay_figure


def replay_figure(replays: Sequence[Comparison], *, detail: bool = False) -> Figure:
    """The drives, and each output of the log with what every replay made of it, over the log's time.

    Parameters
    ----------
    replays: of one log by different models, each model once.
    detail: show only the second in which the drive varies most.

    Raises
    ------
    InputError: no replay, or replays of logs of different length.
    """
    if not replays:
        raise InputError("replay_figure got no replay; give at least one")
    log, system = replays[0].log, replays[0].plant.structure.system
    drives = list(system.drives.values())
    rows = liveliest(log, drives[0]) if detail else slice(None)
    panels: dict[str, dict[str, np.ndarray]] = {}
    for channel in (*drives, *replays[0].fit_percent):
        how = shown(channel)
        panels[how.label] = {"measured": log[channel][rows] / how.scale}
        for replay in replays:
            if channel in replay.simulated:
                panels[how.label][replay.plant.model] = np.asarray(replay.simulated[channel])[rows] / how.scale
    part = ", the second in which the drive varies most" if detail else ""
    return overlay_figure(log.time[rows], panels, title=f"{replays[0].plant.name} beside {log.name}{part}")


@draw.register
def _(replay: Comparison) -> Figure:
    return replay_figure([replay])
