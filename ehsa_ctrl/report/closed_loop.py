"""What a diagnosis means for a closed loop, from closed_loop.json; the command line prints the same table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..core.unit import factor
from ..scenario.metrics import METRICS
from .page import DOUBT, Paragraph, Picture, Section, Sentence, Table
from .text import NOTHING, unit, value_text

#: Metrics of the closed loop that are shown, where a run has them.
CLOSED_LOOP = (
    "RiseTime", "SettlingTime", "SettlingRatio", "Overshoot", "SteadyStateError", "MaxError", "RMSError",
    "HuntingAmplitude", "Slips", "SaturationShare", "CurrentRMS", "Energy", "StopTime", "TravelAfterStop",
)  # fmt: skip
#: A logged current that differs by more than this share of its standard deviation from what the controller computes
#: was recorded under another loop.
OTHER = 0.2


def closed_loop_sentences(closed: Mapping[str, Any]) -> Iterator[Sentence]:
    """Whether the loop keeps its limits, a sentence for each plant."""
    for word, reasons in closed["failures"].items():
        words = "; ".join(reasons) if reasons else "keeps the limits"
        yield f"{closed['scenario']} with {closed['controller']} on the {word} plant: {words}.", not reasons


def closed_loop_section(closed: Mapping[str, Any]) -> Section:
    """What the diagnosis means for a closed loop."""
    head, rows = closed_table(closed)
    caption = "The same controller on the plants, with the scenario's load, sampling and noise; bars: the rod sticks."
    blocks: list[Any] = [
        Paragraph(f"{closed['scenario']} with {closed['controller']}, the controller designed on the nominal plant."),
        Picture("closed_loop", "The closed loop", caption),
        Table("On the nonlinear plant", ["metric", *head, "unit"], rows),
    ]
    if len(closed["failures"]) == 1:
        blocks.append(Paragraph("No cause was named, so that there is no other plant to compare."))
    other = (closed.get("replay") or {}).get("current_not_of_this_loop")
    if other is not None and other > OTHER:
        words = f"differs by {100.0 * other:.0f} % from what this controller computes from the log's own measurements"
        blocks.append(Paragraph(f"The logged current {words}: was it recorded under this loop?", DOUBT))
    return Section("The closed loop", blocks, "closed")


def closed_table(closed: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Head (the plants) and rows (metric, a value a plant, unit) of a closed_loop.json."""
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
    return [f"{word} plant" for word in words], rows
