"""Closed loops of a diagnosis: a scenario on its plants, from closed_loop.json, and the closed-loop replay of the log.

The command line prints the same table of the scenario.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..core.unit import factor
from ..diagnosis.closed_loop_replay import MAX_DRIVE_DIFFERENCE
from ..diagnosis.diagnosis import MODEL_WORDS, models_shown
from ..scenario.metrics import METRICS
from .page import DOUBT, Paragraph, Picture, Section, Sentence, Table
from .signals import signal_display
from .text import NOTHING, percent, unit, value_text

#: Metrics shown if a run has them.
CLOSED_LOOP = (
    "RiseTime", "SettlingTime", "SettlingRatio", "Overshoot", "SteadyStateError", "MaxError", "RMSError",
    "ForceOvershoot", "ForceSettlingTime", "ForceSteadyStateError", "ForceRMSError", "ContactImpact", "LostContacts",
    "FirstCycleError", "LastCycleError", "HuntingAmplitude", "Slips", "SaturationShare", "CurrentRMS", "Energy",
    "ImpedanceError", "StopTime", "TravelAfterStop",
)  # fmt: skip


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
    if deviation is not None and deviation > MAX_DRIVE_DIFFERENCE:
        words = f"differs by {100.0 * deviation:.0f} % from the output of this controller for the logged measurements"
        blocks.append(
            Paragraph(f"The logged current {words}. Check that the log was recorded with this controller.", DOUBT)
        )
    return Section("Closed loop", blocks, "closed")


def replay_section(content: Mapping[str, Any], drawn: Sequence[Any]) -> Section:
    """The gaps of the models under the controller of the log, below the blocks that draw them."""
    gaps, loop, free = content["closed_loop"], content["closed_loop_replay"], content["gap"]
    models = [model for model in models_shown(content["verdict"], gaps) if model in MODEL_WORDS]
    rows = []
    for name in gaps["nominal"]:
        words = name if name == "total" else "position" if name == "position" else signal_display(name).words
        cells = [percent(gaps[model].get(name), 2) for model in models]
        rows.append([words, percent(free["nominal"].get(name), 2), *cells, percent(loop["floor"].get(name), 2)])
    driven = [model for model in models if model in loop["position_error"]]
    errors = [
        ["position error, RMS (mm)", *(value_text(loop["position_error"][model], 1e-3, 3) for model in driven)],
        ["gap of the drive", *(percent(loop["drive_gap"][model], 2) for model in driven)],
    ]
    text = (
        f"The same models under {loop['controller']}, along the logged reference. The loop corrects what differs, so "
        "that its gaps are smaller than those of the free runs; what it has to correct appears in the drive."
    )
    return Section(
        "Closed-loop replay",
        [
            Paragraph(text),
            *drawn,
            Table(
                "Gap on held-out data in closed loop, in % of the signal's standard deviation; floor: by sensor noise",
                ["signal", "free run\nnominal", *(MODEL_WORDS[model] for model in models), "floor"],
                rows,
            ),
            Table("On held-out data in closed loop", ["", *(MODEL_WORDS[model] for model in driven)], errors),
        ],
        "closed_loop_replay",
    )


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
