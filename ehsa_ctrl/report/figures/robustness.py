"""One controller with many plants: |S| and |T| with their bands."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.plotting import draw
from ...design.analysis.loop import LoopAnalysis
from ...design.analysis.robustness import RobustMargins
from ..number import number
from ..style import BLACK, BLUE, GREEN, VERMILION, style
from ._frequency import few_ticks
from ._layout import sheet, stack

#: Of the two panels with their legends above, in.
HEIGHTS = (0.42, 2.3, 0.42, 2.3)
#: Below this |S| and |T| are of no interest, dB.
FLOOR = -25.0
#: Characters of a plant's name in a legend.
NAME = 62


@draw.register
def robustness_figure(robust: RobustMargins) -> Figure:
    """|S| (above) and |T| [dB] over frequency [rad/s]: the band of all plants, the first and the worst one.

    Raises InputError if no loop is stable.
    """
    with style():
        many = len(robust.loops)
        lost = f", {len(robust.unstable)} of them NOT STABLE" if robust.unstable else ""
        figure, start = sheet(
            f"Position loop with {robust.controller} and {many} plants{lost}", header=0.05, heights=HEIGHTS
        )
        first_gap, upper, second_gap, lower = stack(figure, HEIGHTS, top=start, left=0.95, right=0.15, ticks=0.48)
        for gap in (first_gap, second_gap):
            gap.set_axis_off()
        _panel(upper, robust, "S", "Ms", VERMILION)
        _panel(lower, robust, "T", "Mt", GREEN)
        few_ticks([upper, lower])
        lower.set_xlabel("frequency (rad/s), up to half of the sampling's")
        omega, _, highest = robust.band("S")
        lower.set_xlim(0.7 * omega[int(np.argmax(_decibel(highest) > FLOOR))], omega[-1])
    return figure


def _panel(ax: Axes, robust: RobustMargins, symbol: str, margin: str, colour: str) -> None:
    omega, low, high = robust.band(symbol)
    ax.fill_between(omega, _decibel(low), _decibel(high), color=colour, alpha=0.25, linewidth=0)
    stable = {label: loop for label, loop in robust.loops.items() if loop.stable}
    first = next(iter(stable))
    worst = max(stable, key=lambda label: float(getattr(stable[label], margin)))
    shown = [(first, BLUE, "-", 1.5)] + [(worst, colour, (0, (4, 1.5)), 1.5)] * (worst != first)
    for label, own, dashes, width in shown:
        curve = _curve(stable[label], symbol)
        name = textwrap.shorten(label, NAME, placeholder=" ...")
        words = f"{name}: {margin} = {number(round(float(getattr(stable[label], margin)), 3))}"
        ax.semilogx(stable[label].omega, _decibel(curve), color=own, linestyle=dashes, linewidth=width, label=words)
    ax.axhline(0.0, color=BLACK, linewidth=0.7, zorder=1.5)
    top = float(_decibel(np.max(high)))
    ax.set_ylim(FLOOR, top + 4)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.set_ylabel(f"|{symbol}|\n(dB)")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=1, borderpad=0.2, borderaxespad=0.2, labelspacing=0.2)


def _curve(loop: LoopAnalysis, symbol: str) -> np.ndarray:
    return np.abs(loop.sensitivity if symbol == "S" else 1 - loop.sensitivity)


def _decibel(gain: np.ndarray | float) -> np.ndarray:
    """20 log10 of a gain; far below the sheet where it is nearly zero."""
    return np.asarray(20 * np.log10(np.maximum(gain, 1e-6)))
