"""Sheets of panels: a title, room for a legend, and a mosaic of axes placed by matplotlib's constrained layout."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.transforms import blended_transform_factory

from ..style import BLACK, DPI, RC, WIDTH, Sheet, style

#: Height of a line of the title, of a note and of a legend, and of the labels of an axis of time or frequency, in.
TITLE_LINE, NOTE_LINE, LEGEND_LINE, XLABEL = 0.19, 0.15, 0.17, 0.5
#: Height of what separates two panels, in; left edge of title and legend, part of the width.
GAP, LEFT = 0.13, 0.0125
#: Characters of a title and of a note that fit on the width.
TITLE_WIDTH, NOTE_WIDTH = 80, 118


@contextmanager
def sheet(
    title: str,
    mosaic: Sequence[Sequence[str]],
    heights: Sequence[float],
    *,
    widths: Sequence[float] | None = None,
    header: float = 0.0,
    notes: Sequence[str] = (),
    note_color: str = BLACK,
    extra: float = XLABEL,
) -> Iterator[tuple[Sheet, dict[str, Axes]]]:
    """A sheet and its axes, laid out when the block ends; drawing within the block uses the common style.

    Parameters
    ----------
    mosaic: rows of names of axes, as for `Figure.subplot_mosaic`.
    heights: of the rows, in. widths: of the columns, relative.
    header: height for a legend above the panels, in; the axes are then called "header".
    notes: sentences at the top of the header. extra: height for labels in addition to the panels, in.
    """
    lines = [part for line in title.splitlines() for part in textwrap.wrap(line, TITLE_WIDTH)]
    noted = [line for note in notes for line in textwrap.wrap(note, NOTE_WIDTH)]
    header += NOTE_LINE * len(noted)
    total = 0.2 + TITLE_LINE * len(lines) + header + sum(heights) + GAP * len(heights) + extra
    rows: list[Any] = [list(row) for row in mosaic]
    with style():
        spacing = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.03, hspace=0.0, wspace=0.02)
        figure = Sheet(figsize=(WIDTH, total), dpi=DPI, layout=spacing)
        figure.suptitle("\n".join(lines), x=LEFT, ha="left", fontsize=11, fontweight="bold")
        if header:
            rows = [["header"] * len(rows[0]), *rows]
        # Near their final size, panels have their final ticks, whose width decides where the labels are.
        top = 1.0 - (0.1 + TITLE_LINE * len(lines)) / total
        apart = GAP * len(rows) / sum(heights)
        near = {"left": 0.14, "right": 0.98, "bottom": extra / total, "top": top, "hspace": apart}
        axes = figure.subplot_mosaic(
            rows, height_ratios=[header, *heights] if header else list(heights), width_ratios=widths, gridspec_kw=near
        )
        if header:
            axes["header"].set_axis_off()
        if noted:
            place = blended_transform_factory(figure.transFigure, axes["header"].transAxes)
            look: dict[str, Any] = {"va": "top", "fontsize": 8.5, "color": note_color, "transform": place}
            axes["header"].text(LEFT, 1.0, "\n".join(noted), in_layout=False, **look)
        yield figure, axes
        # Laid out once, as layout costs more than drawing, and PNG and SVG must be identical.
        figure.lay_out()
        # A notebook displays a figure at its own resolution, a file has DPI.
        figure.set_dpi(RC["figure.dpi"])


def share_x(axes: Sequence[Axes]) -> None:
    """Let stacked panels share the x axis of the last one."""
    for ax in axes[:-1]:
        ax.sharex(axes[-1])
        ax.tick_params(labelbottom=False)


def header_legend(header: Axes, lines: Sequence[Artist], *, ncols: int = 0, fontsize: float = 9, **look: Any) -> Legend:
    """Add one legend for all panels to the header, in one row by default."""
    figure = header.get_figure()
    assert figure is not None
    legend = header.legend(
        handles=list(lines), loc="lower left", bbox_to_anchor=(LEFT, 0.0), ncols=ncols or len(lines),
        bbox_transform=blended_transform_factory(figure.transFigure, header.transAxes), borderaxespad=0.0,
        borderpad=0.0, fontsize=fontsize, **{"labelspacing": 0.3, **look},
    )  # fmt: skip
    legend.set_in_layout(False)
    return legend
