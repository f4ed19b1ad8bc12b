"""Where panels stand on a sheet, in inches.

Every size is known beforehand, so that no layout engine is needed: it takes longer than all the drawing, each time a
figure is saved. What it would have prevented, words that meet or leave the sheet, the tests look for.
"""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from ..style import WIDTH, Sheet, wrapped

#: Of a line of the title, between panels, below the last, and from the end of a panel's label to the panel.
TITLE, GAP, BOTTOM, TICKS = 0.19, 0.13, 0.5, 0.67


def sheet(title: str, *, header: float, heights: Sequence[float]) -> tuple[Sheet, float]:
    """An empty sheet with its title, of the height that panels of `heights` [in] below a header [in] need.

    Returns the sheet and where the first panel begins, from the top [in].
    """
    lines = wrapped(title)
    top = 0.13 + TITLE * len(lines) + header
    total = top + sum(heights) + GAP * (len(heights) - 1) + BOTTOM
    figure = Sheet(figsize=(WIDTH, total))
    figure.suptitle("\n".join(lines), x=0.0125, y=1 - 0.08 / total, ha="left", fontsize=11, fontweight="bold")
    return figure, top


def stack(
    figure: Sheet, heights: Sequence[float], *, top: float, left: float, right: float, ticks: float = TICKS
) -> list[Axes]:
    """Panels of the given heights, one below the other, that share the axis below; all in inches.

    `top`, `left` and `right` are distances from the edges of the sheet, `ticks` is the room for tick labels.
    """
    total, wide = figure.get_figheight(), WIDTH - left - right
    axes: list[Axes] = []
    for height in heights:
        ax = figure.add_axes((left / WIDTH, 1 - (top + height) / total, wide / WIDTH, height / total))
        ax.yaxis.set_label_coords(-ticks / wide, 0.5)
        ax.tick_params(labelbottom=False)
        top += height + GAP
        axes.append(ax)
    for ax in axes[:-1]:
        ax.sharex(axes[-1])
    axes[-1].tick_params(labelbottom=True)
    return axes
