"""Consequences of a diagnosis for a closed loop, from closed_loop.json; the command line prints the same table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..core.unit import factor
from ..scenario.metrics import METRICS
from .page import DOUBT, Paragraph, Picture, Section, Sentence, Table
from .text import NOTHING, unit, value_text

#: Metrics shown if a run has them.
CLOSED_LOOP = (
    "RiseTime", "SettlingTime", "SettlingRatio", "Overshoot", "SteadyStateError", "MaxError", "RMSError",
    "HuntingAmplitude", "Slips", "SaturationShare", "CurrentRMS", "Energy", "StopTime", "TravelAfterStop",
)  # fmt: skip
#: A logged current that differs from the controller's output by more than this share of its standard deviation was
#: probably recorded with another controller (engineering judgement).
MAX_CURRENT_DEVIATION = 0.2


def plant_title(word: str) -> str:
    """Title of a plant of closed_loop.json, in which "believed" is the nominal plant."""
    return f"{'nominal' if word == 'believed' else word} plant"


def closed_loop_sentences(closed: Mapping[str, Any]) -> Iterator[Sentence]:
    """Whether the loop meets its limits, one sentence per plant."""
    for word, reasons in closed["failures"].items():
        words = "; ".join(reasons) if reasons else "limits met"
        yield f"{closed['scenario']} with {closed['controller']} on the {plant_title(word)}: {words}.", not reasons


def closed_loop_section(closed: Mapping[str, Any]) -> Section:
    """Comparison of the closed loop on the nominal and the improved plant."""
    head, rows = closed_table(closed)
    caption = "The same controller on each plant, with the scenario's load, sampling and noise. Bars: the rod sticks."
    blocks: list[Any] = [
        Paragraph(f"{closed['scenario']} with {closed['controller']}, designed on the nominal plant."),
        Picture("closed_loop", "Closed loop", caption),
        Table("Closed loop on the nonlinear plant", ["metric", *head, "unit"], rows),
    ]
    if len(closed["failures"]) == 1:
        blocks.append(Paragraph("No cause was named, so there is no improved plant to compare."))
    deviation = (closed.get("replay") or {}).get("current_not_of_this_loop")
    if deviation is not None and deviation > MAX_CURRENT_DEVIATION:
        words = f"differs by {100.0 * deviation:.0f} % from the output of this controller for the logged measurements"
        blocks.append(
            Paragraph(f"The logged current {words}. Check that the log was recorded with this controller.", DOUBT)
        )
    return Section("Closed loop", blocks, "closed")


def closed_table(closed: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Head (one entry per plant) and rows (metric, one value per plant, unit) of a closed_loop.json."""
    words = list(closed["plants"])
    rows = []
    for name in CLOSED_LOOP:
        metric = METRICS[name]
        cells = [
            value_text((closed["metrics"].get(name) or {}).get(w), factor(metric.display_unit, metric.unit))
            for w in words
        ]
        if set(cells) != {NOTHING}:
            rows.append([name, *cells, unit(metric.display_unit)])
    gaps = (closed.get("replay") or {}).get("gap", {})
    for signal in gaps.get(words[0], ()):
        cells = [value_text(gaps[word][signal], 0.01, 3) for word in words]
        rows.append([f"gap in {signal.replace('_', ' ')}", *cells, "%"])
    return [plant_title(word) for word in words], rows
