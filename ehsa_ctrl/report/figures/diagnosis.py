"""What a diagnosis explains: a log, and the free runs that it drives as believed and with the causes found."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ...core.plotting import draw
from ...diagnosis.diagnosis import Diagnosis
from ..channel import shown
from ..diagnosis_signals import Trace, after_model, after_words, traces, widest
from ..number import number
from ..style import BLACK, BLUE, GREY, ROLES, style
from . import _panels as panel
from ._layout import GAP, sheet, stack

#: Height of a panel and of the legend, in.
ROW, HEADER = 0.88, 0.42
#: Distances of each column from the left and the right edge of the sheet.
WHOLE, PART = (0.95, 4.5), (4.05, 1.15)
#: More samples than this are pixels in the left column.
POINTS = 1500
DRIVE: dict[str, Any] = {"color": BLUE, "linewidth": 0.9, "drawstyle": "steps-post"}
HELD: dict[str, Any] = {"facecolor": "#ececec", "edgecolor": BLACK, "linewidth": 0.0, "zorder": 0.4}
CLOSE: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.22, "linewidth": 0.0, "zorder": 0.5}


@draw.register
def diagnosis_figure(diagnosis: Diagnosis) -> Figure:
    """A log with the free runs of the plant as believed and with the causes; where they are farthest off on the right.

    One row for the drive, each signal that has a gap, and the position. Beside a signal is its gap on held-out data in
    percent, before and after. What is held out is shaded, where it is a part of this log.
    """
    rows, log = traces(diagnosis), diagnosis.log
    part = widest(diagnosis)
    driven = diagnosis.plant.structure.system.drive
    drive = shown(driven)
    heights = [ROW] * (len(rows) + 1)
    title = f"{diagnosis.plant.name} ({diagnosis.plant.model}) beside {log.name}"
    with style():
        figure, top = sheet(title, header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=0.15, right=0.15)
        header.set_axis_off()
        wholes = stack(figure, heights, top=top, left=WHOLE[0], right=WHOLE[1], ticks=0.5)
        details = stack(figure, heights, top=top, left=PART[0], right=PART[1], ticks=0.4)
        for ax, samples in ((wholes[0], slice(None)), (details[0], part)):
            panel.draw(ax, log.time[samples], log[driven][samples] / drive.scale, DRIVE).set_rasterized(
                ax is wholes[0] and len(log) > POINTS
            )
            panel.hold(ax, [log[driven][samples] / drive.scale], None)
        wholes[0].set_ylabel(_two_lines(drive.label))
        lines: dict[str, Artist] = {}
        for trace, whole, detail in zip(rows, wholes[1:], details[1:], strict=True):
            lines |= _draw(diagnosis, trace, whole, detail, part)
            detail.text(
                1.03, 0.5, _words(diagnosis, trace), transform=detail.transAxes, va="center", fontsize=8,
                linespacing=1.35,
            )  # fmt: skip
        start, stop = log.time[part][[0, -1]]
        held = diagnosis.held_from
        for ax in wholes:
            ax.axvspan(start, stop, **CLOSE)
            if held is not None:
                ax.axvspan(held, log.time[-1], **HELD)
                ax.axvline(held, color=GREY, linestyle=(0, (4, 2)), linewidth=0.9, zorder=1.5)
        wholes[-1].set_xlim(log.time[0], log.time[-1])
        details[-1].set_xlim(start, stop)
        wholes[-1].set_xlabel("time (s), all of the log")
        details[-1].set_xlabel("time (s), where the gap is widest")
        handles = [lines[role] for role in ROLES if role in lines]
        handles.append(Patch(label="widest gap, shown on the right", **CLOSE))
        if held is not None:
            handles.append(Patch(label="held out", **HELD | {"linewidth": 0.6, "linestyle": (0, (4, 2))}))
        header.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0, 0), ncols=3, borderaxespad=0.0, borderpad=0.0,
            labelspacing=0.3, fontsize=8.5,
        )  # fmt: skip
    return figure


def _draw(diagnosis: Diagnosis, trace: Trace, whole: Axes, detail: Axes, part: slice) -> dict[str, Artist]:
    scale = trace.how.scale
    signals = {"measured": trace.measured, "before": trace.before, "after": trace.after}
    drawn: dict[str, Artist] = {}
    for ax, samples in ((whole, slice(None)), (detail, part)):
        values = {role: line[samples] / scale for role, line in signals.items() if line is not None}
        for role, line in values.items():
            look = ROLES[role] | {"label": _label(diagnosis, role)}
            artist = panel.draw(ax, diagnosis.log.time[samples], line, look)
            artist.set_rasterized(ax is whole and line.size > POINTS)
            drawn[role] = artist
        panel.hold(ax, [values[role] for role in ("measured", "after") if role in values], values.get("before"))
    whole.set_ylabel(_two_lines(trace.how.label))
    return drawn


def _label(diagnosis: Diagnosis, role: str) -> str:
    if role == "after":
        return f"after, {after_words(diagnosis)}"
    return "simulated, as believed" if role == "before" and diagnosis.verdict == "no_gap" else str(ROLES[role]["label"])


def _two_lines(label: str) -> str:
    return "\n(".join(label.rsplit(" (", 1))


def _words(diagnosis: Diagnosis, trace: Trace) -> str:
    """The gap of a signal in words."""
    if not trace.scored:
        return "no gap given:\nit drifts in\nfree run"
    after = after_model(diagnosis)
    if after is None:
        return f"held-out gap\n{percent(diagnosis.gap['nominal'][trace.name])}"
    pairs = [("before", "nominal"), ("after", after)]
    return "\n".join(
        ["held-out gap", *(f"{word} {percent(diagnosis.gap[model][trace.name])}" for word, model in pairs)]
    )


def percent(gap: float) -> str:
    """A gap in percent, two digits; a run that stopped has none."""
    return f"{number(float(f'{100.0 * gap:.2g}'))} %" if math.isfinite(gap) else "–"
