"""How far a gap shrinks: as believed, refitted, with the causes found, and at best."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ...diagnosis.diagnosis import MODELS, Diagnosis
from ...diagnosis.signals import SIGNALS
from ..diagnosis_signals import models_shown, signal_shown
from ..style import PURPLE, SKY, VERMILION, style
from ._layout import GAP, sheet, stack
from .diagnosis import percent

#: Height of a bar, of the room below a signal's bars, and of the legend, in.
BAR, REST, HEADER = 0.15, 0.12, 0.62
#: A bar that is longer than this times the longest of the others ends there.
FARTHEST = 3.0
#: How each model's bar looks: lightness and hatching tell them apart without colour.
LOOKS: dict[str, dict[str, Any]] = {
    "nominal": {"facecolor": "#444444"},
    "refit": {"facecolor": SKY, "hatch": "////"},
    "with_effects": {"facecolor": VERMILION},
    "upper_bound": {"facecolor": "white", "hatch": "...."},
}
EDGE: dict[str, Any] = {"edgecolor": "#222222", "linewidth": 0.6}


def shrinkage_figure(diagnosis: Diagnosis) -> Figure:
    """The gap of each signal and in total [%] on held-out data, a bar for each model that says something."""
    models = models_shown(diagnosis)
    signals = [name for name in (*SIGNALS, "total") if name in diagnosis.gap["nominal"]]
    row = BAR * len(models) + REST
    heights = [row * len(signals) + 0.06]
    threshold = 100.0 * diagnosis.threshold
    with style():
        figure, top = sheet("Gap on held-out data", header=HEADER + GAP, heights=heights)
        (header,) = stack(figure, [HEADER], top=top - HEADER - GAP, left=0.15, right=0.15)
        header.set_axis_off()
        (ax,) = stack(figure, heights, top=top, left=1.3, right=0.75)
        end = _reach(diagnosis, models, signals)
        for place, signal in enumerate(signals):
            for index, model in enumerate(models):
                gap = 100.0 * diagnosis.gap[model][signal]
                y = place * row + (index + 0.5) * BAR + REST / 2
                drawn = min(gap, end) if math.isfinite(gap) else end
                ax.barh(y, drawn, height=0.88 * BAR, **LOOKS[model], **EDGE)
                words = percent(gap / 100.0) if math.isfinite(gap) else "run stopped"
                ax.text(drawn + 0.008 * end, y, words, va="center", fontsize=7.5, zorder=3,
                        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4})  # fmt: skip
        ax.axvline(threshold, color=PURPLE, linestyle=(0, (5, 2)), linewidth=1.1, zorder=2)
        ax.set_xlim(0.0, 1.12 * end)
        ax.set_ylim(row * len(signals), 0.0)
        names = [name if name == "total" else signal_shown(name).words for name in signals]
        ax.set_yticks([(place + 0.5) * row for place in range(len(signals))], names)
        ax.tick_params(axis="y", length=0)
        ax.grid(axis="y", visible=False)
        for place in range(1, len(signals)):
            ax.axhline(place * row, color="#cccccc", linewidth=0.6)
        ax.set_xlabel("gap on held-out data (% of the signal's standard deviation)")
        handles: list[Any] = [Patch(label=_words(diagnosis, model), **LOOKS[model], **EDGE) for model in models]
        (line,) = ax.plot([], [], color=PURPLE, linestyle=(0, (5, 2)), linewidth=1.1)
        line.set_label(f"matters from {threshold:g} % on")
        header.legend(
            handles=[*handles, line], loc="lower left", bbox_to_anchor=(0, 0), ncols=2, borderaxespad=0.0,
            borderpad=0.0, labelspacing=0.35, fontsize=8.5,
        )  # fmt: skip
    return figure


def _words(diagnosis: Diagnosis, model: str) -> str:
    words = {"nominal": "before: ", "with_effects": "after: "}.get(model, "")
    return f"{words}{MODELS[model]}"


def _reach(diagnosis: Diagnosis, models: list[str], signals: list[str]) -> float:
    """As far as the longest bar that is not out of all proportion."""
    gaps = sorted(100.0 * diagnosis.gap[m][s] for m in models for s in signals if math.isfinite(diagnosis.gap[m][s]))
    floor = 1.3 * 100.0 * diagnosis.threshold
    if not gaps:
        return floor
    nominal = max((100.0 * diagnosis.gap["nominal"][s] for s in signals), default=0.0)
    longest = nominal if math.isfinite(nominal) else gaps[-1]
    return max(floor, min(gaps[-1], FARTHEST * longest) if longest > 0.0 else gaps[-1])
