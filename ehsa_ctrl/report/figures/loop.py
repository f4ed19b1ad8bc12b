"""A loop and how far it is from instability."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.plotting import draw
from ...design.analysis.loop import LoopAnalysis
from ..number import number
from ..style import BLACK, BLUE, GREEN, VERMILION, style
from ._frequency import arranged, degrees, few_ticks, header, mark, name_marks
from ._layout import sheet, stack

#: Below this |S| and |T| are of no interest, dB.
FLOOR = -45.0
#: Of the panels, in; the low one is room for a legend.
HEIGHTS = (2.0, 1.8, 0.12, 1.8)
#: A margin.
BAR: dict[str, Any] = {"color": VERMILION, "linewidth": 3.0, "zorder": 3, "solid_capstyle": "butt"}


@draw.register
def loop_figure(loop: LoopAnalysis) -> Figure:
    """Open loop: gain [dB] and phase [deg] over frequency [rad/s]; below |S| and |T| [dB] with their peaks.

    Thick bars are the gain margin (top) and the phase margin (middle); what they measure stands above the figure.
    """
    omega, turned = loop.omega, _phase(loop)
    crossover = loop.crossover if np.isfinite([loop.crossover, loop.phase_margin]).all() else None
    turnover = loop.gain_frequency if loop.gain_frequency > 0 else None
    marks = arranged(_margins(loop, crossover, turnover), omega[0], omega[-1], width=0.28)
    stable = "" if loop.stable else ": NOT STABLE when closed"
    title = f"Position loop with {loop.controller}, broken at the current{stable}"
    with style():
        figure, start = sheet(title, header=header(marks), heights=HEIGHTS)
        top, middle, gap, bottom = stack(figure, HEIGHTS, top=start, left=0.95, right=0.15, ticks=0.48)
        gap.set_axis_off()
        top.semilogx(omega, decibel(np.abs(loop.response)), color=BLUE)
        top.axhline(0.0, color=BLACK, linewidth=0.7, zorder=1.5)
        top.set_ylabel("open loop |L|\n(dB)")
        middle.semilogx(omega, turned, color=BLUE)
        middle.axhline(-180.0, color=BLACK, linewidth=0.7, zorder=1.5)
        middle.set_ylabel("phase of L\n(deg)")
        degrees(middle)
        _closed(bottom, loop)
        if crossover is not None:
            mark([top, middle], crossover)
            middle.plot([crossover] * 2, [-180.0, loop.phase_margin - 180.0], **BAR)
        if turnover is not None:
            mark([top, middle], turnover)
            top.plot([turnover] * 2, [0.0, -float(decibel(loop.gain_margin))], **BAR)
        few_ticks([top, middle, bottom])
        name_marks(top, marks)
        bottom.set_xlabel("frequency (rad/s), up to half of the sampling's")
        bottom.set_xlim(omega[0], omega[-1])
    return figure


def _closed(ax: Axes, loop: LoopAnalysis) -> None:
    """|S| and |T| with their peaks."""
    sensitivity = np.abs(1 / (1 + loop.response))
    curves = {
        "S": (sensitivity, loop.Ms, VERMILION, "-"),
        "T": (np.abs(loop.response) * sensitivity, loop.Mt, GREEN, (0, (5, 2))),
    }
    for symbol, (curve, peak, colour, dashes) in curves.items():
        label = f"|{symbol}|, M{symbol.lower()} = {number(peak)}"
        ax.semilogx(loop.omega, decibel(curve), color=colour, linestyle=dashes, label=label)
        k = int(np.argmax(curve))
        ax.plot(loop.omega[k], decibel(curve[k]), marker="o", color=colour, markeredgecolor="white", zorder=3)
    ax.axhline(0.0, color=BLACK, linewidth=0.7, zorder=1.5)
    ax.set_ylim(max(ax.dataLim.y0, FLOOR), ax.dataLim.y1 + 5)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, borderpad=0.2, borderaxespad=0.2)
    ax.set_ylabel("closed loop\n(dB)")


def _margins(loop: LoopAnalysis, crossover: float | None, turnover: float | None) -> Iterator[tuple[float, str]]:
    """What stands above the figure, at its frequency [rad/s]."""
    if crossover is not None:
        delay = f" = {number(1e3 * loop.delay_margin)} ms" if np.isfinite(loop.delay_margin) else ""
        yield crossover, f"crossover {number(crossover)} rad/s\nphase margin {number(loop.phase_margin)}°{delay}"
    if turnover is not None:
        depth = f"{number(loop.gain_margin)} = {number(float(decibel(loop.gain_margin)))} dB"
        yield turnover, f"phase -180° at {number(turnover)} rad/s\ngain margin {depth}"


def decibel(gain: np.ndarray | float) -> np.ndarray:
    """20 log10 of a gain."""
    return np.asarray(20 * np.log10(gain))


def _phase(loop: LoopAnalysis) -> np.ndarray:
    """Phase (n,) [deg], unwrapped, on the turn on which the phase margin at the crossover is the one reported."""
    unwrapped = np.degrees(np.unwrap(np.angle(loop.response)))
    if not np.isfinite([loop.crossover, loop.phase_margin]).all():
        return unwrapped - 360 * np.round(unwrapped[0] / 360)
    at = np.interp(np.log(loop.crossover), np.log(loop.omega), unwrapped)
    return unwrapped - 360 * np.round((at - loop.phase_margin + 180) / 360)
