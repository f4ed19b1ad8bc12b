"""A diagnosis: location of the gap, unknown inputs, fitted hypotheses, gap of each model."""

from __future__ import annotations

import math
import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, NullLocator

from ...core.errors import InputError
from ...diagnosis.diagnosis import MODEL_WORDS, NAMING, Diagnosis, RankedHypothesis, models_shown
from ...diagnosis.gap_attribution import Location
from ...diagnosis.regimes import Regime
from ...diagnosis.unknown_inputs import UNITS
from ...physics.effects import PLACES
from ..outcome import after_model, outcome
from ..signals import BALANCES, signal_display, unit_of_balance
from ..style import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION
from ..text import number, percent, unit
from ._layout import LEGEND_LINE, header_legend, sheet

EDGE: dict[str, Any] = {"edgecolor": "#222222", "linewidth": 0.6}
#: Shares by place and the gap over time.
CAUSES: dict[str, Any] = {"label": "by the causes found", "facecolor": BLUE} | EDGE
FREE: dict[str, Any] = {"label": "by the balances, without the catalogue", "facecolor": SKY, "hatch": "////"} | EDGE
BEFORE: dict[str, Any] = {"facecolor": "#dddddd"} | EDGE
LEFT: dict[str, Any] = {"facecolor": GREEN, "hatch": "xxxx"} | EDGE
#: Unknown inputs over time, and along the variable that they depend on.
OVER_TIME: dict[str, Any] = {"color": BLUE, "linewidth": 0.7}
CURVE: dict[str, Any] = {"color": VERMILION, "linewidth": 1.5, "marker": "o", "markersize": 3.5, "zorder": 2.5}
#: Characters in a line below a panel; longer signals than POINTS samples are rasterised.
LABEL_WIDTH, POINTS = 36, 1500
#: Height of a hypothesis, of each line of its name beyond two, in; hypotheses that are drawn.
ROW, LINE, DRAWN = 0.29, 0.11, 12
#: Outcome of a hypothesis -> its words in the legend and the look of its bar.
OUTCOMES: dict[str, tuple[str, dict[str, Any]]] = {
    "named": ("named", {"facecolor": VERMILION}),
    "equivalent": ("not distinguishable", {"facecolor": "#f3c9a8", "hatch": "////"}),
    "redundant": ("more than needed", {"facecolor": "white", "hatch": "...."}),
    "excluded": ("excluded", {"facecolor": SKY}),
    "tried": ("tried", {"facecolor": SKY}),
    "possible": ("possible", {"facecolor": "#f3c9a8", "hatch": "////"}),
}
#: Height of a bar and of the gap below a signal's bars, in; a bar longer than FARTHEST times the nominal one is cut.
BAR, REST, FARTHEST = 0.15, 0.12, 3.0
#: Look of each model's bar: lightness and hatching distinguish them without colour.
LOOKS: dict[str, dict[str, Any]] = {
    "nominal": {"facecolor": "#444444"},
    "refit": {"facecolor": SKY, "hatch": "////"},
    "with_effects": {"facecolor": VERMILION},
    "with_law": {"facecolor": GREEN, "hatch": "xxxx"},
    "upper_bound": {"facecolor": "white", "hatch": "...."},
}


def where_figure(diagnosis: Diagnosis) -> Figure:
    """Shares of the gap by place [%], and the squared gap per second [% of the total].

    Left: shares from the named causes, if any, and from the balances, which use no catalogue. Right: gap of the nominal
    plant, and gap that remains with the estimated unknown inputs.

    Raises InputError if there is no gap.
    """
    if not diagnosis.where:
        raise InputError("where_figure got a diagnosis without a gap; there is no place to show")
    location = diagnosis.location
    rows: list[tuple[dict[str, float], dict[str, Any]]] = []
    if diagnosis.verdict in NAMING or location is None:
        rows.append((dict(diagnosis.where), CAUSES))
    if location is not None:
        rows.append((dict(location.shares), FREE))
    panels = ["places", *(["time"] if location is not None else [])]
    with sheet("Where the gap lies", [panels], [2.0], header=0.3) as (figure, axes):
        _shares(axes["places"], rows)
        if location is not None:
            _gap_over_time(axes["time"], location)
        header_legend(axes["header"], [Patch(**look) for _, look in rows], fontsize=8, handlelength=1.6)
    return figure


def _shares(ax: Axes, rows: list[tuple[dict[str, float], dict[str, Any]]]) -> None:
    height = 0.8 / len(rows)
    for index, (shares, look) in enumerate(rows):
        for place, name in enumerate(PLACES):
            y = place - 0.4 + (index + 0.5) * height
            share = 100.0 * shares.get(name, 0.0)
            if share >= 0.5:
                ax.barh(y, share, height=0.9 * height, **{k: v for k, v in look.items() if k != "label"})
                ax.text(share + 1.5, y, f"{share:.0f} %", va="center", fontsize=8)
    ax.set_xlim(0.0, 118.0)
    ax.set_xticks([0, 25, 50, 75, 100])
    _bar_rows(ax, list(PLACES))
    ax.set_xlabel("share of the gap (%)")


def _bar_rows(ax: Axes, names: list[str], **look: Any) -> None:
    """Label horizontal bars, the first one on top."""
    ax.set_yticks(range(len(names)), names, **look)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)


def _gap_over_time(ax: Axes, location: Location) -> None:
    start, before, left = np.array(location.over_time, dtype=float).reshape(-1, 3).T
    ends = np.append(start[1:], location.time[-1])
    widths = np.maximum(ends - start, 1e-9)
    ax.bar(start, 100.0 * before, widths, align="edge", **BEFORE)
    handles = [Patch(label="nominal plant", **BEFORE)]
    top = 100.0 * max(float(np.max(before, initial=0.0)), 1e-6)
    # A sensor error is not an input of any balance, so there is no corrected run.
    if location.place != "sensor":
        ax.bar(start, 100.0 * left, widths, align="edge", **LEFT)
        handles.append(Patch(label="with the unknown inputs", **LEFT))
        top = max(top, 100.0 * float(np.max(left, initial=0.0)))
    ax.set_xlim(location.time[0], location.time[-1])
    ax.set_ylim(0.0, 1.42 * top)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("squared gap\n(% of all, each second)")
    ax.legend(
        handles=handles, loc="upper left", fontsize=8, borderaxespad=0.3, borderpad=0.0, handlelength=1.6,
        labelspacing=0.3,
    )  # fmt: skip


def unknown_inputs_figure(diagnosis: Diagnosis) -> Figure:
    """Unknown input of each balance over time, and over the two variables that explain it best.

    Right: mean per bin of the variable, with a band of one standard deviation; the title gives the share of the unknown
    input that the dependence explains on data that was not fitted.

    Raises InputError if no balance has an unknown input.
    """
    location = diagnosis.location
    rows = regimes_by_balance(location)
    if location is None or not rows:
        raise InputError("unknown_inputs_figure got a diagnosis without an unknown input; there is nothing to show")
    names = ("time", "best", "next")
    mosaic = [[f"{b} {n}" if k <= len(rows[b]) else "." for k, n in enumerate(names)] for b in rows]
    count = len(rows)
    with sheet("Unknown inputs of the balances", mosaic, [1.3] * count, widths=(1.3, 1, 1), extra=0.85 * count) as (
        figure,
        axes,
    ):
        for balance, regimes in rows.items():
            _over_time(axes[f"{balance} time"], location, balance)
            for word, regime in zip(names[1:], regimes, strict=False):
                _along(axes[f"{balance} {word}"], regime, f"{word}: {100.0 * regime.explained:.0f} % explained")
    return figure


def regimes_by_balance(location: Location | None) -> dict[str, list[Regime]]:
    """The first two regimes of each balance that has any, best first."""
    found: dict[str, list[Regime]] = {}
    for regime in location.regimes if location is not None else ():
        found.setdefault(regime.balance, []).append(regime)
    return {balance: regimes[:2] for balance, regimes in found.items()}


def _over_time(ax: Axes, location: Location, balance: str) -> None:
    usual, scale = unit_of_balance(UNITS[balance])
    values = location.unknown[balance] / scale
    line = ax.plot(location.time, values, **OVER_TIME)[0]
    line.set_rasterized(values.size > POINTS)
    known = values[np.isfinite(values)]
    if known.size:
        # A few outliers at reversals of the motion would compress the axis.
        low, high = np.quantile(known, [0.005, 0.995])
        span = max(float(high - low), 1e-9 * float(np.max(np.abs(known))), 1e-30)
        ax.set_ylim(min(low, 0.0) - 0.25 * span, max(high, 0.0) + 0.25 * span)
    ax.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1.5)
    ax.set_xlim(location.time[0], location.time[-1])
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.set_title("over time", loc="left", fontsize=8.5)
    ax.set_ylabel(f"{BALANCES[balance]}\n({unit(usual)})")
    ax.set_xlabel("time (s)")


def _along(ax: Axes, regime: Regime, title: str) -> None:
    _, scale = unit_of_balance(UNITS[regime.balance])
    variable, by = unit_of_balance(regime.unit)
    z, mean, sd = regime.bins / by, regime.mean / scale, regime.sd / scale
    if z.size > 2:
        ax.fill_between(z, mean - sd, mean + sd, color=VERMILION, alpha=0.2, linewidth=0)
        ax.plot(z, mean, **CURVE)
    else:
        ax.errorbar(z, mean, sd, **CURVE | {"linestyle": "none"}, capsize=4)
        ax.margins(x=0.4)
    ax.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1.5)
    ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.yaxis.set_major_locator(MaxNLocator(5))
    if regime.unit == "":
        ax.set_xlim(-1.6, 1.6)
        ax.set_xticks([-1, 1], ["−1", "+1"])
    words = f"{regime.against} ({unit(variable)})" if variable not in ("", "1") else regime.against
    ax.set_title(title, loc="left", fontsize=8.5)
    ax.set_xlabel(textwrap.fill(words, LABEL_WIDTH), fontsize=8)


def candidates_figure(diagnosis: Diagnosis) -> Figure:
    """The best hypotheses with twice their distance in log-likelihood from the best one, and their largest gap.

    Logarithmic axis: the longer a bar, the worse the hypothesis. Values below 1 are drawn at 1.

    Raises InputError if no hypothesis was fitted.
    """
    if not diagnosis.candidates:
        raise InputError("candidates_figure got a diagnosis without candidates; there is nothing to compare")
    rows = diagnosis.candidates[:DRAWN]
    causes = {cause.name: cause.ambiguous_with for cause in diagnosis.effects}
    outcomes = [outcome(diagnosis.verdict, causes, candidate.members) for candidate in rows]
    most = max(len(_name_lines(candidate)) for candidate in rows)
    heights = [(ROW + LINE * max(most - 2, 0)) * (len(rows) + 0.4)]
    with sheet("Hypotheses that were fitted", [["bars"]], heights, header=0.3) as (figure, axes):
        _hypotheses(axes["bars"], rows, outcomes)
        handles = [Patch(label=words, **look, **EDGE) for word, (words, look) in OUTCOMES.items() if word in outcomes]
        header_legend(axes["header"], handles, fontsize=8.5)
        axes["bars"].text(1.02, 1.0, "held-out\ngap", transform=axes["bars"].transAxes, va="bottom", fontsize=8)
    return figure


def _hypotheses(ax: Axes, rows: tuple[RankedHypothesis, ...], outcomes: list[str]) -> None:
    evidence = [max(candidate.evidence, 1.0) if math.isfinite(candidate.evidence) else 1e9 for candidate in rows]
    end = 10.0 ** math.ceil(math.log10(2.0 * max(*evidence, 10.0)))
    for row, (candidate, value, word) in enumerate(zip(rows, evidence, outcomes, strict=True)):
        ax.barh(row, value - 0.7, left=0.7, height=0.7, **OUTCOMES[word][1], **EDGE)
        words = "best" if candidate.evidence <= 0.0 else number(float(f"{candidate.evidence:.3g}"))
        ax.text(1.15 * value, row, words, va="center", fontsize=8)
        ax.text(1.02, row, percent(candidate.gap, 2), transform=ax.get_yaxis_transform(), va="center", fontsize=8)
    ax.set_xscale("log")
    ax.set_xlim(0.7, 4.0 * end)
    decades = range(round(math.log10(end)) + 1)
    ax.set_xticks([10.0**power for power in decades], [number(10.0**power) for power in decades])
    ax.xaxis.set_minor_locator(NullLocator())
    _bar_rows(ax, ["\n".join(_name_lines(candidate)) for candidate in rows], fontsize=7.5, linespacing=1.05)
    ax.set_xlabel("2 Δ log-likelihood to the best hypothesis (longer is worse)")


def _name_lines(candidate: RankedHypothesis, longest: int = 48) -> list[str]:
    """The name of a hypothesis, broken into lines of at most `longest` characters."""
    lines: list[str] = []
    for member in candidate.members:
        if lines and len(lines[-1]) + 3 + len(member) <= longest:
            lines[-1] += f" + {member}"
        else:
            lines.append(f"+ {member}" if lines else member)
    return lines or ["nominal parameters alone"]


def shrinkage_figure(diagnosis: Diagnosis) -> Figure:
    """The gap of each signal and in total [%] on held-out data, one bar per model."""
    models = models_shown(diagnosis.verdict, diagnosis.gap)
    signals = list(diagnosis.gap["nominal"])
    row = BAR * len(models) + REST
    threshold = 100.0 * diagnosis.threshold
    look: dict[str, Any] = {"color": PURPLE, "linestyle": (0, (5, 2)), "linewidth": 1.1}
    heights = [row * len(signals) + 0.06]
    # The bars of the models and the threshold, two a row.
    header = LEGEND_LINE * math.ceil((len(models) + 1) / 2) + 0.1
    with sheet("Gap on held-out data", [["bars"]], heights, header=header) as (figure, axes):
        ax = axes["bars"]
        end = _reach(diagnosis, models, signals)
        for place, signal in enumerate(signals):
            for index, model in enumerate(models):
                gap = diagnosis.gap[model][signal]
                y = place * row + (index + 0.5) * BAR + REST / 2
                drawn = min(100.0 * gap, end) if math.isfinite(gap) else end
                ax.barh(y, drawn, height=0.88 * BAR, **LOOKS[model], **EDGE)
                words = percent(gap, 2) if math.isfinite(gap) else "run stopped"
                box = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}
                ax.text(drawn + 0.008 * end, y, words, va="center", fontsize=7.5, zorder=3, bbox=box)
        line = ax.axvline(threshold, zorder=2, label=f"relevant from {threshold:g} % on", **look)
        ax.set_xlim(0.0, 1.12 * end)
        names = [name if name == "total" else signal_display(name).words for name in signals]
        _bar_rows(ax, names)
        ax.set_ylim(row * len(signals), 0.0)
        ax.set_yticks([(place + 0.5) * row for place in range(len(signals))], names)
        for place in range(1, len(signals)):
            ax.axhline(place * row, color="#cccccc", linewidth=0.6)
        ax.set_xlabel("gap on held-out data (% of the signal's standard deviation)")
        before = {"nominal": "before: ", after_model(diagnosis.verdict, models): "after: "}
        labels = [f"{before.get(model, '')}{MODEL_WORDS[model]}" for model in models]
        handles = [Patch(label=label, **LOOKS[model], **EDGE) for model, label in zip(models, labels, strict=True)]
        header_legend(axes["header"], [*handles, line], ncols=2, fontsize=8.5)
    return figure


def _reach(diagnosis: Diagnosis, models: list[str], signals: list[str]) -> float:
    """End of the axis: the longest bar that is at most FARTHEST times the nominal one."""
    gaps = sorted(100.0 * diagnosis.gap[m][s] for m in models for s in signals if math.isfinite(diagnosis.gap[m][s]))
    floor = 1.3 * 100.0 * diagnosis.threshold
    if not gaps:
        return floor
    nominal = max((100.0 * diagnosis.gap["nominal"][s] for s in signals), default=0.0)
    longest = nominal if math.isfinite(nominal) else gaps[-1]
    return max(floor, min(gaps[-1], FARTHEST * longest) if longest > 0.0 else gaps[-1])
