"""The page of a comparison: how well free runs of a plant fit a log, and what is doubtful in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...identification.comparison import GOOD, POOR, fit_words, quality
from ..page import DOUBT, Facts, Kind, Page, Paragraph, Picture, Points, Section, Sentence
from ..text import value_text
from ._tables import FITS, findings_section, fit_table, plant_name, settings_of, steps_of, words_of

NOTE = (
    "Each model is simulated in free run with the log's drive. A fit of 100 % is exact, 0 % is no better than the "
    f"mean; from {GOOD:g} % on it is called good, below {POOR:g} % poor, and fair between."
)


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    models = content["models"]
    sentences = [_sentence(name, model) for name, model in models.items()]
    sentences += [(f"Doubtful in the log: {words_of(each).rstrip('.')}.", DOUBT) for each in content["findings"]]
    facts = [("log", str(content["log"])), ("time", f"{value_text(content['from'])} to {value_text(content['to'])} s")]
    if "samples" in content:
        facts.append(("samples", f"{content['samples']}, {value_text(content['sample_time'], 1e-3)} ms apart"))
    facts += [(f"{name} model starts", model["start"]["words"]) for name, model in models.items() if "start" in model]
    steps, untold = steps_of(content), content.get("untold") or []
    return Page(
        title=f"Comparison of {Path(str(content['log'])).name} with {plant_name(content)}",
        sentences=sentences,
        notes=[NOTE],
        sections=[
            Section(
                "Measured and simulated",
                [
                    fit_table("Fit in free run, %", {name: model["fit_percent"] for name, model in models.items()}),
                    Picture("compare", "The whole log", "Free runs, driven by the logged drive alone.", True),
                    Picture("compare-detail", "In detail", "The second in which the drive varies most.", True),
                ],
                "runs",
            ),
            findings_section(content["findings"]),
            Section(
                "The log",
                [
                    Facts(facts),
                    Paragraph("Preparation:" if steps else "It was used as recorded."),
                    Points(steps),
                    *([Paragraph("What it cannot show:"), Points(untold)] if untold else []),
                ],
                "log",
            ),
        ],
        facts=settings_of({**content, "model": ""}),
        versions=content["provenance"],
    )


def _sentence(name: str, model: Mapping[str, Any]) -> Sentence:
    known = {channel: fit for channel, fit in model["fit_percent"].items() if fit is not None}
    if model["stopped"]:
        return f"{name} model: the free run ended early, no fit is given: {model['stopped'].rstrip('.')}.", False
    if not known:
        return f"{name} model: no channel moved, so that there is no fit.", False
    ordered = sorted(known, key=lambda channel: known[channel])
    worst, best = ordered[0], ordered[-1]
    ends = f"{value_text(known[worst])} % ({worst})"
    if len(ordered) > 1:
        ends = f"from {ends} to {value_text(known[best])} % ({best})"
    return f"{name} model: the fit is {ends}: {fit_words(known)}.", FITS[quality(known[worst])]


KIND = Kind("comparison.json", "comparison", _read)
