"""Which parameters trade places."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ...core.errors import InputError
from ...identification.identification import Identification
from ...identification.uncertainty import TRADES
from ...plant.file import both
from ..style import BLACK, BLUE, WIDTH, style
from ._layout import GAP, sheet, stack

#: As dark as BLUE.
RUST = "#a34800"
#: Blue for minus and red for plus, equally dark where equally strong: in grey the sign is in the numbers.
COLOURS = LinearSegmentedColormap.from_list("correlation", [BLUE, "#ffffff", RUST])
#: A cell is at most so wide, and the whole so wide, in.
CELL, ALL = 0.6, 5.6
#: Height of the note, and of a letter of a name lengthwise, in.
HEADER, SYMBOL = 0.22, 0.075


def correlation_figure(identification: Identification) -> Figure:
    """Correlation of each pair of estimates, as a triangle of numbers in coloured cells.

    A pair beyond +-0.9 has a frame: the logs tell the sum or the ratio of the two better than each. A dash stands for a
    parameter of which the logs tell nothing, and for all of them if they are from balances.

    Raises InputError if nothing was estimated.
    """
    found = identification.uncertainty
    count = len(found.names)
    if not count:
        raise InputError("correlation_figure got an identification without parameters; estimate at least one")
    matrix = found.correlation
    # Balances are solved one after the other: how their errors hang together is not known.
    blind = ~np.isfinite(found.sd) | (found.sd <= 0.0) | (identification.method == "balances")
    cell = min(CELL, ALL / count)
    names = list(map(both, found.names))
    longest = SYMBOL * max(map(len, names))
    # Names below are turned by 45 deg.
    heights = [count * cell, max(0.7 * longest - 0.3, 0.0)]
    left = max(0.3 + longest, 0.9)
    plant = identification.plant
    with style():
        title = f"{plant.name} ({plant.model}): correlation of the estimates"
        figure, top = sheet(title, header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=0.15, right=0.15)
        header.set_axis_off()
        header.text(
            0, 0.5, f"framed: beyond ±{TRADES:g}, the two trade places", transform=header.transAxes, va="center",
            fontsize=8.5,
        )  # fmt: skip
        (ax,) = stack(figure, heights[:1], top=top, left=left, right=WIDTH - left - count * cell)
        ax.grid(visible=False)
        lower = np.where(np.tri(count, k=-1, dtype=bool) & ~(blind[:, None] | blind[None, :]), matrix, np.nan)
        edges = np.arange(count + 1)
        ax.pcolormesh(edges, edges, np.ma.masked_invalid(lower), cmap=COLOURS, vmin=-1.0, vmax=1.0)
        for row in range(count):
            ax.add_patch(Rectangle((row, row), 1, 1, facecolor="#e4e4e4", edgecolor="none"))
            for column in range(row):
                _write(ax, row, column, float(lower[row, column]), min(8.0, 15.0 * cell))
        centres = edges[:-1] + 0.5
        ax.set_xticks(centres, names, rotation=45, ha="right", rotation_mode="anchor")
        ax.set_yticks(centres, names)
        ax.tick_params(length=0)
        ax.set_xlim(0, count)
        ax.set_ylim(count, 0)
        for side in ax.spines.values():
            side.set_visible(False)
    return figure


def _write(ax: Axes, row: int, column: int, value: float, size: float) -> None:
    """The number in its cell, a frame around a strong one."""
    # Rounded first, so that no zero has a sign.
    words = "–" if np.isnan(value) else f"{round(value, 2) + 0.0:.2f}".replace("-", "−")
    ink = "white" if abs(value) > 0.78 else BLACK
    ax.text(column + 0.5, row + 0.5, words, ha="center", va="center", fontsize=size, color=ink)
    if abs(value) > TRADES:
        frame = Rectangle((column + 0.05, row + 0.05), 0.9, 0.9, fill=False, linewidth=2.2, edgecolor=BLACK)
        ax.add_patch(frame)
