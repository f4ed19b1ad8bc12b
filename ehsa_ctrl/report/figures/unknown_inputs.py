"""What the balances lack: unknown torque, flows and force over time and along what they follow best."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.errors import InputError
from ...core.unit import factor
from ...diagnosis.diagnosis import Diagnosis
from ...diagnosis.gap_attribution import Location
from ...diagnosis.regimes import Regime
from ...diagnosis.unknown_inputs import UNITS
from ..channel import SHOWN
from ..number import unit
from ..style import BLACK, BLUE, VERMILION, WIDTH, style
from ._layout import GAP, sheet, stack

#: Height of a panel, of the words above it and below it, in.
ROW, ABOVE, BELOW = 1.3, 0.3, 0.55
#: Units in which a person reads an unknown input, and variables that no channel has.
READ = SHOWN | {"m3/s": "cm3/s", "Pa/s": "bar/s", "rad/s Pa": "rad bar/s", "m/s2": "m/s2", "N": "N", "m3": "cm3"}
NAMES = {
    "torque": "unknown torque", "flow_1": "unknown flow into chamber 1", "flow_2": "unknown flow into chamber 2",
    "force": "unknown force",
}  # fmt: skip
#: Where the three columns begin and how wide they are, in.
LEFT, WIDE = (0.8, 3.6, 6.1), (2.3, 1.75, 1.75)
OVER_TIME: dict[str, Any] = {"color": BLUE, "linewidth": 0.7}
CURVE: dict[str, Any] = {"color": VERMILION, "linewidth": 1.5, "marker": "o", "markersize": 3.5, "zorder": 2.5}
#: Characters in a line below a panel.
WORDS = 36
#: More samples than this are pixels.
POINTS = 1500


def unknown_inputs_figure(diagnosis: Diagnosis) -> Figure:
    """A row for each balance that lacks something: its unknown input over time, and along what it follows best.

    Right: mean in bins of the variable, the band is one standard deviation within a bin; above it how much of the
    unknown input the regime explains on data that was not fitted, and beside it the next best.

    Raises InputError if no balance lacks anything that could be shown.
    """
    location = diagnosis.location
    rows = regimes_by_balance(location)
    if location is None or not rows:
        raise InputError("unknown_inputs_figure got a diagnosis without an unknown input; there is nothing to show")
    heights = [*([ABOVE + ROW + BELOW] * (len(rows) - 1)), ABOVE + ROW + 0.18]
    with style():
        figure, top = sheet("What the balances lack", header=0.0, heights=heights)
        for balance, regimes in rows.items():
            (over,) = stack(figure, [ROW], top=top + ABOVE, left=LEFT[0], right=WIDTH - LEFT[0] - WIDE[0], ticks=0.5)
            _over(over, location, balance)
            for number_of, (regime, left, wide) in enumerate(zip(regimes, LEFT[1:], WIDE[1:], strict=False)):
                (along,) = stack(figure, [ROW], top=top + ABOVE, left=left, right=WIDTH - left - wide)
                _along(along, regime)
                _above(along, f"{('best', 'next')[number_of]}: {100.0 * regime.explained:.0f} % explained")
            _above(over, f"{NAMES[balance]}, over time")
            top += ABOVE + ROW + BELOW + GAP
    return figure


def _above(ax: Axes, words: str) -> None:
    ax.text(0.0, 1.04, words, transform=ax.transAxes, va="bottom", fontsize=8.5)


def regimes_by_balance(location: Location | None) -> dict[str, list[Regime]]:
    """The first two regimes of each balance that has any, best first."""
    found: dict[str, list[Regime]] = {}
    for regime in location.regimes if location is not None else ():
        found.setdefault(regime.balance, []).append(regime)
    return {balance: regimes[:2] for balance, regimes in found.items()}


def read_unit(si: str) -> tuple[str, float]:
    """The unit in which a quantity is read, and the SI units in one of it."""
    usual = READ.get(si, si)
    return usual, factor(usual, si) if usual != si else 1.0


def _over(ax: Axes, location: Location, balance: str) -> None:
    usual, scale = read_unit(UNITS[balance])
    values = location.unknown[balance] / scale
    line = ax.plot(location.time, values, **OVER_TIME)[0]
    line.set_rasterized(values.size > POINTS)
    known = values[np.isfinite(values)]
    if known.size:
        # A few samples at reversals, where friction turns over, are far off; they would flatten all the others.
        low, high = np.quantile(known, [0.005, 0.995])
        span = max(float(high - low), 1e-9 * float(np.max(np.abs(known))), 1e-30)
        ax.set_ylim(min(low, 0.0) - 0.25 * span, max(high, 0.0) + 0.25 * span)
    ax.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1.5)
    ax.set_xlim(location.time[0], location.time[-1])
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.set_ylabel(unit(usual))
    ax.set_xlabel("time (s)")


def _along(ax: Axes, regime: Regime) -> None:
    ax.yaxis.set_major_locator(MaxNLocator(5))
    _, scale = read_unit(UNITS[regime.balance])
    variable, by = read_unit(regime.unit)
    z, mean, sd = regime.bins / by, regime.mean / scale, regime.sd / scale
    if z.size > 2:
        ax.fill_between(z, mean - sd, mean + sd, color=VERMILION, alpha=0.2, linewidth=0)
        ax.plot(z, mean, **CURVE)
    else:
        ax.errorbar(z, mean, sd, **CURVE | {"linestyle": "none"}, capsize=4)
        ax.margins(x=0.4)
    ax.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1.5)
    ax.xaxis.set_major_locator(MaxNLocator(4))
    if regime.unit == "":
        ax.set_xlim(-1.6, 1.6)
        ax.set_xticks([-1, 1], ["−1", "+1"])
    words = f"{regime.against} ({unit(variable)})" if variable not in ("", "1") else regime.against
    ax.set_xlabel(textwrap.fill(words, WORDS), fontsize=8)
