"""What an identification changed: a log, and the free runs that it drives before and after."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.errors import InputError
from ...core.plotting import draw
from ...identification.comparison import Comparison
from ...identification.identification import Identification
from ..channel import liveliest, shown
from ..number import number
from ..style import BLUE, ROLES, style
from . import _panels as panel
from ._layout import GAP, sheet, stack

#: Height of a panel and of the legend, in.
ROW, HEADER = 1.2, 0.25
#: Distances of each column from the left and the right edge of the sheet.
WHOLE, PART = (0.95, 4.55), (4.0, 1.1)
#: More samples than this are pixels in the left column: it shows where the runs drift, not each sample.
POINTS = 1500
#: A drive is nobody's result, and held from sample to sample.
DRIVE: dict[str, Any] = {"color": BLUE, "linewidth": 0.9, "drawstyle": "steps-post"}


@draw.register
def identification_figure(identification: Identification, index: int = 0) -> Figure:
    """A log with the free runs of the plant as believed before and as identified; a detail on the right.

    One row for each drive and output, as in Fig. 7 and 8 of the paper. Left the whole log, right the second in which
    the drive varies most. Beside each output is its fit in percent. A run that leaves the measured range far behind
    also leaves the panel.

    Parameters
    ----------
    index: which of the logs that were held out, or of those used where none was.

    Raises
    ------
    InputError: there is no such log.
    """
    held_out = bool(identification.validation.after)
    reach = identification.validation if held_out else identification.train
    if not 0 <= index < len(reach.after):
        raise InputError(f"identification_figure got index {index}; expected 0 to {len(reach.after) - 1}")
    before, after = reach.before[index], reach.after[index]
    log, system = after.log, after.plant.structure.system
    drives = list(system.drives.values())
    channels = [*drives, *after.fit_percent]
    rows = liveliest(log, drives[0])
    heights = [ROW] * len(channels)
    plant = identification.plant
    title = f"{plant.name} ({plant.model}) beside {log.name}, {'held out' if held_out else 'used to identify'}"
    with style():
        figure, top = sheet(title, header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=WHOLE[0], right=0.15)
        header.set_axis_off()
        wholes = stack(figure, heights, top=top, left=WHOLE[0], right=WHOLE[1], ticks=0.5)
        details = stack(figure, heights, top=top, left=PART[0], right=PART[1], ticks=0.4)
        lines: dict[str, Artist] = {}
        for channel, whole, detail in zip(channels, wholes, details, strict=True):
            signals = _signals(channel, before, after)
            for ax, part in ((whole, slice(None)), (detail, rows)):
                for role, values in signals.items():
                    line = panel.draw(ax, log.time[part], values[part], DRIVE if channel in drives else ROLES[role])
                    line.set_rasterized(ax is whole and len(log) > POINTS)
                    lines |= {} if channel in drives else {role: line}
                shown_part = {role: values[part] for role, values in signals.items()}
                kept = [shown_part[role] for role in ("measured", "after") if role in shown_part]
                panel.hold(ax, kept, shown_part.get("before"))
            whole.set_ylabel("\n(".join(shown(channel).label.rsplit(" (", 1)))
            if channel in after.fit_percent:
                _say(detail, before.fit_percent[channel], after.fit_percent[channel])
        start, stop = log.time[rows][[0, -1]]
        for ax in wholes:
            ax.axvspan(start, stop, color=BLUE, alpha=0.12, linewidth=0, zorder=0.5)
        wholes[-1].set_xlim(log.time[0], log.time[-1])
        details[-1].set_xlim(start, stop)
        wholes[-1].set_xlabel("time (s), all of the log")
        details[-1].set_xlabel("time (s), the shaded part")
        panel.legend(header, [lines[role] for role in ROLES if role in lines])
    return figure


def _signals(channel: str, before: Comparison, after: Comparison) -> dict[str, np.ndarray]:
    """What was measured and simulated of a channel, (N,) each, in the shown unit."""
    scale = shown(channel).scale
    found = {"measured": np.asarray(after.log[channel]) / scale}
    for role, run in (("before", before), ("after", after)):
        if channel in run.fit_percent:
            found[role] = np.asarray(run.simulated[channel]) / scale
    return found


def _say(ax: Axes, before: float, after: float) -> None:
    """The fit beside a panel; nan is a run that ended before its log, or a channel that stood still."""
    words = [
        f"{word} –" if math.isnan(value) else f"{word} {number(value).replace('-', '−')} %"
        for word, value in (("before", before), ("after", after))
    ]
    ax.text(1.03, 0.5, "\n".join(["fit", *words]), transform=ax.transAxes, va="center", fontsize=8)
