"""Figure of a law that a diagnosis proposes: the unknown input and the law along a variable, and what is left."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.errors import InputError
from ...diagnosis.diagnosis import Diagnosis
from ...physics.effects import ADDENDS
from ..signals import unit_of_balance
from ..style import BLACK, BLUE, GREEN, VERMILION
from ..text import unit
from ._layout import LEGEND_LINE, header_legend, sheet

#: Bins along the variable, each with the same number of samples. Engineering judgement.
BINS = 30


def law_figure(diagnosis: Diagnosis) -> Figure:
    """The unknown input along the first variable of the law: mean per bin with the standard deviation of the mean.

    Left: with the most probable form, from the regression. Right: what the law leaves. Dry friction and the
    flow of a displacement change their sign with the direction of motion, so that both directions are drawn apart.

    Raises InputError for a diagnosis without a law.
    """
    law = diagnosis.law
    if law is None:
        raise InputError("law_figure got a diagnosis without a law; there is nothing to show")
    known = np.isfinite(law.measured)
    usual, scale = unit_of_balance(ADDENDS[law.place].balance_unit)
    words = law.variables[0] if law.variables else "variable"
    parts = _parts(law.direction, known)
    title = f"Law: {law.forms[0].file.expression}"
    with sheet(title, [["law", "left"]], [2.6], header=len(parts) * LEGEND_LINE + 0.1) as (figure, axes):
        for name, rows, color, line in parts:
            z, measured, fitted = law.variable[rows], law.measured[rows] / scale, law.fitted[rows] / scale
            which = _bins(z)
            _band(axes["law"], z, measured, which, color, f"unknown input{name}")
            means = _means(z, fitted, which)
            axes["law"].plot(means[:, 0], means[:, 1], line, color=VERMILION, lw=1.8, zorder=3, label=f"law{name}")
            _band(axes["left"], z, measured - fitted, which, color, "")
        axes["law"].set_title("unknown input and law", loc="left", fontsize=8.5)
        axes["law"].set_ylabel(f"{ADDENDS[law.place].meaning.partition(',')[0]}\n({unit(usual)})")
        # One row for each direction.
        handles, _ = axes["law"].get_legend_handles_labels()
        header_legend(axes["header"], [*handles[::2], *handles[1::2]], ncols=2, fontsize=8.5)
        axes["left"].set_title("what the law leaves", loc="left", fontsize=8.5)
        axes["left"].sharey(axes["law"])
        for ax in (axes["law"], axes["left"]):
            ax.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1.5)
            ax.set_xlabel(f"{words} ({unit(law.unit)})")
            # More labels touch each other.
            ax.xaxis.set_major_locator(MaxNLocator(5))
    return figure


def _parts(direction: np.ndarray, known: np.ndarray) -> list[tuple[str, np.ndarray, str, str]]:
    """Name, samples (N - 1,), colour and line of each curve: one for all motion, or one for each direction."""
    if not direction.size:
        return [("", known, BLUE, "-")]
    return [
        (", positive motion", known & (direction > 0.0), BLUE, "-"),
        (", negative motion", known & (direction < 0.0), GREEN, "--"),
    ]


def _bins(z: np.ndarray) -> np.ndarray:
    """(n,) number of the bin of each value; bins have as many values each."""
    edges = np.unique(np.quantile(z, np.linspace(0.0, 1.0, BINS + 1))) if z.size else z
    return np.clip(np.searchsorted(edges, z, "right") - 1, 0, max(edges.size - 2, 0))


def _means(z: np.ndarray, y: np.ndarray, which: np.ndarray) -> np.ndarray:
    """(bins, 3) mean of z, and mean of y with its standard deviation in each bin.

    Samples of one passage through a bin are alike, so that each passage counts once.
    """
    begins = np.flatnonzero(np.diff(which, prepend=-1))
    rows = []
    for k in np.unique(which):
        inside, passages = which == k, np.count_nonzero(which[begins] == k)
        rows.append([np.mean(z[inside]), np.mean(y[inside]), np.std(y[inside]) / np.sqrt(passages)])
    return np.array(rows).reshape(-1, 3)


def _band(ax: Axes, z: np.ndarray, y: np.ndarray, which: np.ndarray, color: str, label: str) -> None:
    """Mean in each bin, with its standard deviation."""
    rows = _means(z, y, which)
    ax.fill_between(rows[:, 0], rows[:, 1] - rows[:, 2], rows[:, 1] + rows[:, 2], color=color, alpha=0.2, linewidth=0)
    ax.plot(rows[:, 0], rows[:, 1], color=color, linewidth=1.0, marker="o", markersize=3, label=label or None)
