"""The style of all figures.

Lines differ by colour (the palette of M. Okabe and K. Ito for colour-blind readers) and, in black and white, by dashes
and width. Nothing here changes matplotlib's global state.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import matplotlib
import matplotlib.style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

BLACK, GREY, BLUE, SKY, VERMILION, GREEN, PURPLE = (
    "#000000", "#7a7a7a", "#0072b2", "#56b4e9", "#d55e00", "#009e73", "#8b3a74",
)  # fmt: skip

#: 8 in at 150 dpi are 1200 px; on A4 the same figure is scaled to about nine tenths.
WIDTH, DPI = 8.0, 150
#: Longer lines are rasterised, so that a browser still displays the page quickly (engineering judgement).
RASTER_POINTS = 20_000

RC: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#555555",
    # No power of ten in a corner: it would overlap the panel above.
    "axes.formatter.limits": (-5, 6),
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "axes.titlesize": 9,
    "axes.unicode_minus": True,
    "axes.xmargin": 0.0,
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "legend.handlelength": 3.2,
    "lines.dash_capstyle": "butt",
    "lines.linewidth": 1.3,
    "lines.scale_dashes": True,
    "savefig.dpi": DPI,
    # These two make the file reproducible: the same bytes in every run and on machines with other fonts.
    "svg.fonttype": "path",
    "svg.hashsalt": "ehsa_ctrl",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
}

#: Role of a signal -> line style, in every figure.
ROLES: dict[str, dict[str, Any]] = {
    "reference": {"label": "reference", "color": BLACK, "linestyle": (0, (6, 3)), "linewidth": 1.1, "zorder": 2.2},
    "measured": {
        "label": "measured", "color": SKY, "linestyle": "none", "marker": "o", "markersize": 2.2, "markeredgewidth": 0,
        "zorder": 2.1,
    },
    "linear": {
        "label": "linear model", "color": "#222222", "linestyle": (0, (5, 1.5, 1, 1.5)), "linewidth": 0.9,
        "zorder": 2.4,
    },
    "nonlinear": {"label": "nonlinear model", "color": VERMILION, "linestyle": "-", "linewidth": 1.6, "zorder": 2.3},
    "before": {
        "label": "before (nominal)", "color": "#444444", "linestyle": (0, (3, 1.2)), "linewidth": 1.0, "zorder": 2.3,
    },
    "after": {
        "label": "after (identified)", "color": VERMILION, "linestyle": "-", "linewidth": 1.2, "zorder": 2.4,
    },
}  # fmt: skip
#: Line styles of the pressure panel.
PRESSURES: dict[str, dict[str, Any]] = {
    "P_1": {"label": "P₁", "color": BLUE, "linestyle": "-", "linewidth": 1.5},
    "P_2": {"label": "P₂", "color": GREEN, "linestyle": (0, (4, 1.2)), "linewidth": 1.3},
}
LIMIT: dict[str, Any] = {"color": PURPLE, "linewidth": 1.1, "zorder": 2.6}
#: Dashes of the first, second and third limit in a panel: those of pump and motor are close together.
LIMIT_DASHES = ((0, (8, 2, 2, 2)), (0, (2, 1)), (0, (10, 3)))


class Sheet(Figure):
    """A figure that a notebook displays without pyplot."""

    def draw(self, renderer: Any) -> None:
        """Draw user text literally."""
        self.make_text_literal()
        super().draw(renderer)

    def make_text_literal(self) -> None:
        """$ does not start a formula, and invalid UTF-8 becomes question marks.

        Only tick labels may contain formulas, which matplotlib itself generates.
        """
        for text in _texts(self):
            text.set_parse_math(False)
            text.set_text(text.get_text().encode(errors="replace").decode())

    def lay_out(self) -> None:
        """Place axes and labels of the y axes for good: to align these anew at each drawing costs half of it.

        Positions are rounded for reproducibility: the solver's last digits depend on the order of its variables in
        memory.
        """
        self.make_text_literal()
        engine = self.get_layout_engine()
        assert engine is not None
        # The layout must leave room for aligned labels. Padding aligns them; matplotlib's own alignment asks each
        # panel for all others in its column whenever it needs one of them.
        columns = self._columns()
        for side, axes in columns:
            room = [_label_distance(ax, side) for ax in axes]
            for ax, one in zip(axes, room, strict=True):
                ax.yaxis.labelpad += (max(room) - one) * 72.0 / self.dpi
        engine.execute(self)
        # None rather than "none": a place holder makes every savefig draw the figure twice.
        self.set_layout_engine(None)
        for ax in self.axes:
            ax.set_position(Bbox(ax.get_position(original=True).get_points().round(5)))
            ax.apply_aspect()
        for side, axes in columns:
            furthest = max(_label_distance(ax, side) for ax in axes)
            for ax in axes:
                share = furthest / ax.bbox.width
                ax.yaxis.set_label_coords(round(-share if side == "left" else 1.0 + share, 4), 0.5)

    def _columns(self) -> list[tuple[str, list[Axes]]]:
        """Axes whose y labels are on the same side of the same column, with that side."""
        columns: dict[tuple[str, int], list[Axes]] = {}
        for ax in self.axes:
            place = ax.get_subplotspec()
            if place is not None:
                side: str = ax.yaxis.get_label_position()
                edge = place.colspan.start if side == "left" else place.colspan.stop
                columns.setdefault((side, edge), []).append(ax)
        return [(side, axes) for (side, _), axes in columns.items()]

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        with style():
            self.savefig(stream, format="png", dpi=100, metadata={"Software": None})
        return stream.getvalue()


def _texts(artist: Artist) -> Iterator[Text]:
    """All text within an artist but tick labels, whose ticks matplotlib would place anew to list them."""
    if isinstance(artist, Text):
        yield artist
    parts = [artist.label, artist.offsetText] if isinstance(artist, Axis) else artist.get_children()
    for part in parts:
        yield from _texts(part)


def _label_distance(ax: Axes, side: str) -> float:
    """Distance of the y label from the axes, in pixels."""
    ax.yaxis.get_tightbbox()  # places the label
    x = ax.yaxis.label.get_position()[0]
    return float(ax.bbox.x0 - x if side == "left" else x - ax.bbox.x1)


@contextmanager
def style() -> Iterator[None]:
    """Context with matplotlib's defaults and RC, whatever the user's settings."""
    with matplotlib.style.context(RC, after_reset=True):
        yield
