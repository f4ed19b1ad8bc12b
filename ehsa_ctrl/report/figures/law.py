"""Figure of a law that a diagnosis proposes: the unknown input and the law along a variable, and what is left."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.errors import InputError
from ...diagnosis.diagnosis import Diagnosis
from ...physics.effects import ADDENDS
from ..signals import unit_of_balance
from ..style import BLACK, BLUE, VERMILION
from ..text import unit
from ._layout import sheet

#: Bins along the variable, each with the same number of samples. Engineering judgement.
BINS = 30


def law_figure(diagnosis: Diagnosis) -> Figure:
    """The unknown input along the first variable of the law: mean per bin with a band of one standard deviation.

    Left: with the most probable form, from the regression. Right: without it.

    Raises InputError for a diagnosis without a law.
    """
    law = diagnosis.law
    if law is None:
        raise InputError("law_figure got a diagnosis without a law; there is nothing to show")
    known = np.isfinite(law.measured)
    z, measured, fitted = law.variable[known], law.measured[known], law.fitted[known]
    edges = np.unique(np.quantile(z, np.linspace(0.0, 1.0, BINS + 1)))
    which = np.clip(np.searchsorted(edges, z, "right") - 1, 0, max(edges.size - 2, 0))
    usual, scale = unit_of_balance(ADDENDS[law.place].unit)
    words = law.variables[0] if law.variables else "variable"
    with sheet(f"Law: {law.forms[0].file.expression}", [["law", "left"]], [2.6]) as (figure, axes):
        _band(axes["law"], z, measured / scale, which)
        means = np.array([[np.mean(z[which == k]), np.mean(fitted[which == k])] for k in np.unique(which)])
        axes["law"].plot(means[:, 0], means[:, 1] / scale, color=VERMILION, linewidth=1.8, zorder=3)
        axes["law"].set_title("unknown input (band) and law (line)", loc="left", fontsize=8.5)
        axes["law"].set_ylabel(f"{ADDENDS[law.place].meaning.partition(',')[0]}\n({unit(usual)})")
        _band(axes["left"], z, (measured - fitted) / scale, which)
        axes["left"].set_title("without the law", loc="left", fontsize=8.5)
        axes["left"].sharey(axes["law"])
        for ax in (axes["law"], axes["left"]):
            ax.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1.5)
            ax.set_xlabel(f"{words} ({unit(law.unit)})")
    return figure


def _band(ax: Axes, z: np.ndarray, y: np.ndarray, which: np.ndarray) -> None:
    """Mean and standard deviation in each bin."""
    rows = np.array([[np.mean(z[which == k]), np.mean(y[which == k]), np.std(y[which == k])] for k in np.unique(which)])
    ax.fill_between(rows[:, 0], rows[:, 1] - rows[:, 2], rows[:, 1] + rows[:, 2], color=BLUE, alpha=0.2, linewidth=0)
    ax.plot(rows[:, 0], rows[:, 1], color=BLUE, linewidth=1.0, marker="o", markersize=3)
