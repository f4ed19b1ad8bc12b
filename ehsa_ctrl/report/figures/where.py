"""Where a gap lies: what each place has of it, and when it comes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ...core.errors import InputError
from ...diagnosis.diagnosis import Diagnosis
from ...diagnosis.gap_attribution import PLACES, Location
from ..style import BLUE, GREEN, SKY, WIDTH, style
from ._layout import GAP, sheet, stack

#: Height of the panels and of the legend, in.
ROW, HEADER = 2.0, 0.3
EDGE: dict[str, Any] = {"edgecolor": "#222222", "linewidth": 0.6}
CAUSES: dict[str, Any] = {"label": "by the causes found", "facecolor": BLUE} | EDGE
FREE: dict[str, Any] = {"label": "by the balances, without the catalogue", "facecolor": SKY, "hatch": "////"} | EDGE
BEFORE: dict[str, Any] = {"facecolor": "#dddddd"} | EDGE
LEFT: dict[str, Any] = {"facecolor": GREEN, "hatch": "xxxx"} | EDGE


def where_figure(diagnosis: Diagnosis) -> Figure:
    """Shares of the gap by place [%], and the squared gap second by second [% of all of it].

    Left, where causes were named: their shares beside those of the balances, which know no catalogue. Right: the gap of
    the plant as believed, and what is left of it once the unknown inputs are put into the balances.

    Raises InputError if there is no gap and so no place.
    """
    if not diagnosis.where:
        raise InputError("where_figure got a diagnosis without a gap; there is no place to show")
    location = diagnosis.location
    rows: list[tuple[dict[str, float], dict[str, Any]]] = []
    named = diagnosis.verdict in ("effect", "ambiguous")
    if named or location is None:
        rows.append((dict(diagnosis.where), CAUSES))
    if location is not None:
        rows.append((dict(location.shares), FREE))
    with style():
        figure, top = sheet("Where the gap lies", header=HEADER + GAP, heights=[ROW])
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=0.15, right=0.15)
        header.set_axis_off()
        (ax,) = stack(figure, [ROW], top=top, left=0.75, right=WIDTH - 3.9 if location is not None else 0.7)
        _shares(ax, rows)
        if location is not None:
            (time,) = stack(figure, [ROW], top=top, left=4.95, right=0.2, ticks=0.45)
            _over_time(time, location)
        header.legend(
            handles=[Patch(**look) for _, look in rows], loc="lower left", bbox_to_anchor=(0, 0), ncols=2,
            borderaxespad=0.0, borderpad=0.0, handlelength=1.6, columnspacing=1.2, fontsize=8,
        )  # fmt: skip
    return figure


def _shares(ax: Axes, rows: list[tuple[dict[str, float], dict[str, Any]]]) -> None:
    height = 0.8 / len(rows)
    for index, (shares, look) in enumerate(rows):
        for place, name in enumerate(PLACES):
            y = place - 0.4 + (index + 0.5) * height
            share = 100.0 * shares.get(name, 0.0)
            if share < 0.5:
                continue
            ax.barh(y, share, height=0.9 * height, **{k: v for k, v in look.items() if k != "label"})
            ax.text(share + 1.5, y, f"{share:.0f} %", va="center", fontsize=8)
    ax.set_xlim(0.0, 118.0)
    ax.set_xticks([0, 25, 50, 75, 100])
    ax.set_ylim(len(PLACES) - 0.5, -0.5)
    ax.set_yticks(range(len(PLACES)), PLACES)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("share of the gap (%)")


def _over_time(ax: Axes, location: Location) -> None:
    start, before, left = np.array(location.over_time, dtype=float).reshape(-1, 3).T
    ends = np.append(start[1:], location.time[-1])
    widths = np.maximum(ends - start, 1e-9)
    ax.bar(start, 100.0 * before, widths, align="edge", **BEFORE)
    handles = [Patch(label="as believed", **BEFORE)]
    top = 100.0 * max(float(np.max(before, initial=0.0)), 1e-6)
    # What a sensor errs by is put into no balance, so that nothing is taken away there.
    if location.place != "sensor":
        ax.bar(start, 100.0 * left, widths, align="edge", **LEFT)
        handles.append(Patch(label="with the unknown inputs put in", **LEFT))
        top = max(top, 100.0 * float(np.max(left, initial=0.0)))
    ax.set_xlim(location.time[0], location.time[-1])
    ax.set_ylim(0.0, 1.42 * top)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("squared gap\n(% of all, each second)")
    ax.legend(
        handles=handles, loc="upper left", fontsize=8, borderaxespad=0.3, borderpad=0.0, handlelength=1.6,
        labelspacing=0.3,
    )  # fmt: skip
