"""Panels over time: axis ranges, strips with phases, exceeded plant limits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from ...core.unit import factor
from ...simulation.limits import BOUNDED, SHOWN, Exceedance, range_of
from ...simulation.trajectory import Trajectory
from ..signals import SIGNALS, Signal, spans
from ..style import BLUE, GREY, LIMIT, LIMIT_DASHES, RASTER_POINTS, Sheet
from ..text import quantity
from ._layout import share_x, sheet

#: Height of a panel and of a row of a strip, in.
PANEL, ROW = 1.3, 0.17
#: Panel that shows a limit of the plant. Averages over the run (power, current_rms) can't be drawn over time.
WHERE = {"motor_torque": "current"} | {
    limit: "pressures" if "P_1" in states else states[0] for limit, (states, *_) in BOUNDED.items()
}
#: Colours of the strips' bars.
STUCK, FORCE = GREY, BLUE

Phase = tuple[float, float, str]


@contextmanager
def column(
    title: str, heights: Mapping[str, float], notes: Sequence[str] = ()
) -> Iterator[tuple[Sheet, dict[str, Axes]]]:
    """Panels of the given heights [in] over a common axis of time [s], with a header for a legend."""
    rows, sizes = [[name] for name in heights], list(heights.values())
    with sheet(title, rows, sizes, header=0.25, notes=notes, note_color=LIMIT["color"]) as (figure, axes):
        panels = [axes[name] for name in heights]
        share_x(panels)
        panels[-1].set_xlabel("time (s)")
        yield figure, axes


def draw(ax: Axes, time: np.ndarray, values: np.ndarray, how: Mapping[str, Any]) -> Artist:
    """Draw values (N,), already in display units, as a line with every point."""
    (line,) = ax.plot(time, values, **how)
    line.set_rasterized(len(time) > RASTER_POINTS)
    return line


def set_range(ax: Axes, signal: Signal) -> None:
    """Label the panel and set a range that contains its lines but does not magnify noise around a constant."""
    ax.set_ylabel(signal.label)
    low, high = ax.dataLim.y0, ax.dataLim.y1
    if not np.isfinite([low, high]).all():
        low = high = 0.0
    span = max(high - low, signal.least) or max(abs(low), 1.0)
    middle = (low + high) / 2
    ax.set_ylim(middle - 0.56 * span, middle + 0.56 * span)


def set_range_around(ax: Axes, signals: Iterable[np.ndarray], before: np.ndarray | None) -> None:
    """Set a range that contains the signals, and the run `before` up to one span beyond them."""
    low, high = _extremes(signals)
    span = max(high - low, 1e-6 * max(abs(low), abs(high), 1e-300))
    if before is not None:
        lowest, highest = _extremes([before])
        low, high = max(min(low, lowest), low - span), min(max(high, highest), high + span)
    span = high - low or span
    ax.set_ylim(low - 0.06 * span, high + 0.06 * span)


def _extremes(signals: Iterable[np.ndarray]) -> tuple[float, float]:
    values = np.concatenate(list(signals))
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)


def panel_legend(ax: Axes, lines: Sequence[Artist]) -> None:
    """Add a legend to the right of the panel."""
    if lines:
        ax.legend(
            list(lines), [str(line.get_label()) for line in lines], loc="center left", bbox_to_anchor=(1.0, 0.5),
            handlelength=2.2, handletextpad=0.5, borderaxespad=0.4, borderpad=0.0, fontsize=8,
        )  # fmt: skip


def phases(time: np.ndarray, on: np.ndarray) -> list[Phase]:
    """Intervals (start, end, "") [s] in which `on` (N,) is true."""
    return [(*span, "") for span in spans(time, on)]


def levels(time: np.ndarray, force: np.ndarray) -> list[Phase]:
    """Intervals (start, end, "3 kN") [s] of constant nonzero force (N,) [N]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[np.nan], force, [np.nan]])) != 0)
    ends = np.append(time, time[-1])
    signal = SIGNALS["force"]
    return [
        (float(time[a]), float(ends[b]), quantity(force[a] / signal.scale, signal.display_unit))
        for a, b in zip(edges[:-1], edges[1:], strict=True)
        if force[a] != 0
    ]


def strip(ax: Axes, rows: Mapping[str, tuple[Sequence[Phase], str]]) -> None:
    """Rows of bars that show phases: name -> (phases, colour); the text of a phase is written in its bar."""
    ax.set_gid("strip")
    ax.grid(axis="y", visible=False)
    start, end = ax.get_xlim()
    for row, (bars, colour) in enumerate(rows.values()):
        if not bars:
            ax.text((start + end) / 2, row + 0.55, "never", ha="center", va="center", fontsize=8, color=GREY)
        ax.broken_barh([(a, b - a) for a, b, _ in bars], (row + 0.1, 0.8), facecolor=colour, edgecolor="none")
        for a, b, words in bars:
            inside = b - a > 0.1 * (end - start)
            place = (a + b) / 2 if inside else b + 0.005 * (end - start)
            ax.text(
                place, row + 0.55, words, ha="center" if inside else "left", va="center", fontsize=8,
                color="white" if inside else "black", clip_on=True,
            )  # fmt: skip
    ax.set_ylim(len(rows), 0)
    ax.set_yticks([row + 0.5 for row in range(len(rows))], list(rows))
    ax.tick_params(axis="y", length=0)


def shade(axes: Iterable[Axes], bars: Sequence[Phase]) -> None:
    """Tint the phases in the background of other panels."""
    for ax in axes:
        for start, end, _ in bars:
            ax.axvspan(start, end, color=BLUE, alpha=0.07, linewidth=0, zorder=0.5)


def exceeded_limits(panels: Mapping[str, Axes], run: Trajectory) -> dict[str, list[Artist]]:
    """Draw each exceeded limit as a line, with a cross at the first sample beyond it.

    Returns the lines of each panel, for its legend.
    """
    drawn: dict[str, list[Artist]] = {name: [] for name in panels}
    for trip in run.exceeded:
        name = WHERE.get(trip.limit, "")
        if name not in panels:
            continue
        ax, values = panels[name], _watched(run, trip)
        low, high = _bounds(run, trip)
        how = LIMIT | {"linestyle": LIMIT_DASHES[len(drawn[name]) % len(LIMIT_DASHES)]}
        # A limit can be passed between two samples: no sample lies beyond then, and the nearer side is the one.
        reach = {edge: sign * (peak - edge) for sign, edge, peak in ((1, high, values.max()), (-1, low, values.min()))}
        sides = [edge for edge, by in reach.items() if by > 0] or [max(reach, key=lambda edge: reach[edge])]
        for edge in sides:
            line = ax.axhline(edge, **how)
            ax.update_datalim([(run.time[0], edge)], updatex=False)
        line.set_label(f"{trip.limit.replace('_', ' ')}\n{_allowed(trip)}")
        drawn[name].append(line)
        first = np.flatnonzero((values < low) | (values > high))
        if first.size:
            k = first[0]
            ax.plot(
                run.time[k], low if values[k] < low else high, marker="X", markersize=8, color=LIMIT["color"],
                markeredgecolor="white", linestyle="none", zorder=3, clip_on=False,
            )  # fmt: skip
    return drawn


def exceeded_words(trips: Iterable[Exceedance], expected: Sequence[str] = ()) -> list[str]:
    """Sentences about exceeded limits for the header, as limits on averages have no line."""
    return [f"limit exceeded{', as expected' if trip.limit in expected else ''}: {trip}" for trip in trips]


def _watched(run: Trajectory, trip: Exceedance) -> np.ndarray:
    """The signal (N,) that a limit applies to, in the unit of its panel."""
    panel = WHERE[trip.limit]
    if panel == "pressures":
        highest = trip.limit == "pressure_max"
        values = (np.maximum if highest else np.minimum)(run["P_1"], run["P_2"])
    else:
        values = run[panel]
    return SIGNALS[panel].read(values)


def _bounds(run: Trajectory, trip: Exceedance) -> tuple[float, float]:
    """Lower and upper bound of the panel's signal: a torque limit as a current, a stroke as half to either side."""
    scale = SIGNALS[WHERE[trip.limit]].scale
    if trip.limit == "motor_torque":
        bound = trip.allowed / scale / run.plant["K_T"]
        return -bound, bound
    low, high = range_of(trip.limit, trip.allowed)
    return low / scale, high / scale


def _allowed(trip: Exceedance) -> str:
    shown = SHOWN[trip.limit]
    allowed = trip.allowed / factor(shown, trip.unit)
    # The stroke is centred at zero: its lines lie at half of it.
    return f"±{quantity(allowed / 2, shown)}" if trip.limit == "stroke" else quantity(allowed, shown)
