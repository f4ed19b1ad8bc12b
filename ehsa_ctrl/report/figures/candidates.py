"""Which causes were tried, and how much worse each explains the log than the best."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from ...core.errors import InputError
from ...diagnosis.diagnosis import Diagnosis, RankedHypothesis
from ..number import number
from ..style import SKY, VERMILION, WIDTH, style
from ._layout import GAP, sheet, stack
from .diagnosis import percent

#: Height of a row, of each line of a name beyond two, and of the legend, in; candidates that are drawn.
ROW, LINE, HEADER, DRAWN = 0.29, 0.11, 0.3, 12
#: Left and right of the bars, in, and where the gaps end, in widths of the bars.
LEFT, RIGHT = 3.6, 1.1
BESIDE = 1.0 + (RIGHT - 0.2) / (WIDTH - LEFT - RIGHT)
EDGE: dict[str, Any] = {"edgecolor": "#222222", "linewidth": 0.6}
#: What became of a candidate, and how its bar looks.
LOOKS: dict[str, dict[str, Any]] = {
    "named": {"facecolor": VERMILION},
    "can't be told from it": {"facecolor": "#f3c9a8", "hatch": "////"},
    "more than is needed": {"facecolor": "white", "hatch": "...."},
    "excluded": {"facecolor": SKY},
    "tried": {"facecolor": SKY},
    "possible": {"facecolor": "#f3c9a8", "hatch": "////"},
}


def fate(diagnosis: Diagnosis, candidate: RankedHypothesis) -> str:
    """What became of a candidate, in words: one of LOOKS.

    Where no cause was named none was excluded in favour of another: those were tried, or are possible.
    """
    causes = {cause.name: cause for cause in diagnosis.effects}
    members = set(candidate.members)
    if diagnosis.verdict == "outside_catalogue":
        return "tried"
    alike = {name: {name, *cause.ambiguous_with} for name, cause in causes.items()}
    if diagnosis.verdict == "underdetermined":
        known = set().union(*alike.values()) if alike else set()
        return "possible" if members and all(m in known or _id(m) in known for m in members) else "tried"
    gone, come = set(causes) - members, members - set(causes)
    if not gone:
        return "more than is needed" if come else "named"
    # One cause in another's place, and perhaps more beside it: what contains a rival is not excluded either.
    if len(gone) == 1 and any(_id(name) in alike[next(iter(gone))] for name in come):
        return "can't be told from it" if len(come) == 1 else "more than is needed"
    return "excluded"


def _id(member: str) -> str:
    return member.partition(" (")[0]


def candidate_name(candidate: RankedHypothesis) -> str:
    """Its members, as a table has them."""
    return " + ".join(candidate.members) or "nominal parameters alone"


def candidates_figure(diagnosis: Diagnosis) -> Figure:
    """The best hypotheses with their evidence against the best of all, on a logarithmic axis; beside it their gap.

    Evidence is twice the difference of the log-likelihoods: the longer a bar, the worse. What lies below 1 is drawn
    at 1.

    Raises InputError if none was refitted.
    """
    if not diagnosis.candidates:
        raise InputError("candidates_figure got a diagnosis without candidates; there is nothing to compare")
    rows = diagnosis.candidates[:DRAWN]
    most = max(len(_lines(candidate)) for candidate in rows)
    heights = [(ROW + LINE * max(most - 2, 0)) * (len(rows) + 0.4)]
    with style():
        figure, top = sheet("What else could explain the log", header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=0.15, right=0.15)
        header.set_axis_off()
        (ax,) = stack(figure, heights, top=top, left=LEFT, right=RIGHT)
        fates = [fate(diagnosis, candidate) for candidate in rows]
        _bars(ax, rows, fates)
        header.legend(
            handles=[Patch(label=word, **LOOKS[word], **EDGE) for word in LOOKS if word in fates], loc="lower left",
            bbox_to_anchor=(0, 0), ncols=4, borderaxespad=0.0, borderpad=0.0, fontsize=8.5,
        )  # fmt: skip
        header.text(
            1.0 - 0.05 / WIDTH,
            0.0,
            "largest gap, held out",
            transform=header.transAxes,
            ha="right",
            va="bottom",
            fontsize=8.5,
        )
    return figure


def _bars(ax: Axes, rows: tuple[RankedHypothesis, ...], fates: list[str]) -> None:
    evidence = [max(candidate.evidence, 1.0) if math.isfinite(candidate.evidence) else 1e9 for candidate in rows]
    end = 10.0 ** math.ceil(math.log10(2.0 * max(*evidence, 10.0)))
    for row, (candidate, value, word) in enumerate(zip(rows, evidence, fates, strict=True)):
        ax.barh(row, value - 0.7, left=0.7, height=0.7, **LOOKS[word], **EDGE)
        said = "best" if candidate.evidence <= 0.0 else number(float(f"{candidate.evidence:.3g}"))
        ax.text(1.15 * value, row, said, va="center", fontsize=8)
        ax.text(BESIDE, row, percent(candidate.gap), transform=ax.get_yaxis_transform(), va="center", ha="right",
                fontsize=8)  # fmt: skip
    ax.set_xscale("log")
    ax.set_xlim(0.7, 4.0 * end)
    decades = range(round(math.log10(end)) + 1)
    ax.set_xticks([10.0**power for power in decades], [number(10.0**power) for power in decades])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_yticks(
        range(len(rows)), ["\n".join(_lines(candidate)) for candidate in rows], fontsize=7.5, linespacing=1.05
    )
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("evidence against it, relative to the best (longer is worse)")


def _lines(candidate: RankedHypothesis, longest: int = 48) -> list[str]:
    """Its name, in as many lines as that takes."""
    lines: list[str] = []
    for member in candidate.members:
        if lines and len(lines[-1]) + 3 + len(member) <= longest:
            lines[-1] += f" + {member}"
        else:
            lines.append(f"+ {member}" if lines else member)
    return lines or [candidate_name(candidate)]
