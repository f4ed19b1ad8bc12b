"""The page of a comparison: fit of a plant's free runs to a log, and the quality of the log's data."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...identification.comparison import GOOD, POOR, fit_words, quality
from ..page import DOUBT, Facts, Kind, Page, Paragraph, Picture, Points, Section, Sentence
from ..text import value_text
from ._charts import charted, comparison_chart
from ._tables import FITS, findings_section, fit_table, plant_name, settings_of, steps_of

NOTE = (
    "Each model is simulated in free run with the logged input. A fit of 100 % is exact, 0 % is no better than the "
    f"mean of the measurement. A fit of at least {GOOD:g} % is good, below {POOR:g} % poor, otherwise fair."
)


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    models = content["models"]
    sentences = [_sentence(name, model) for name, model in models.items()]
    sentences += [(f"Data quality: {each['sentence'].rstrip('.')}.", DOUBT) for each in content["findings"]]
    facts = [("log", str(content["log"])), ("time", f"{value_text(content['from'])} to {value_text(content['to'])} s")]
    if "samples" in content:
        facts.append(("samples", f"{content['samples']}, {value_text(content['sample_time'], 1e-3)} ms apart"))
    facts += [(f"{name} model starts", model["start"]["words"]) for name, model in models.items() if "start" in model]
    pictures = [
        Picture("compare", "Whole log", "Free runs, driven by the logged input alone.", True),
        Picture("compare-detail", "Detail", "The second in which the input varies most.", True),
    ]
    steps, untold = steps_of(content), content.get("untold") or []
    return Page(
        title=f"Comparison of {Path(str(content['log'])).name} with {plant_name(content)}",
        sentences=sentences,
        notes=[NOTE],
        sections=[
            Section(
                "Measured and simulated",
                [
                    *charted(comparison_chart(folder, list(models), pictures), pictures),
                    fit_table("Fit in free run, %", {name: model["fit_percent"] for name, model in models.items()}),
                ],
                "runs",
            ),
            findings_section(content["findings"]),
            Section(
                "The log",
                [
                    Facts(facts),
                    Paragraph("Preparation:" if steps else "The log was used as recorded."),
                    Points(steps),
                    *([Paragraph("What this log cannot show:"), Points(untold)] if untold else []),
                ],
                "log",
                folded=True,
            ),
        ],
        facts=settings_of({**content, "model": ""}),
        versions=content["provenance"],
    )


def _sentence(name: str, model: Mapping[str, Any]) -> Sentence:
    title = f"{name.capitalize()} model"
    known = {channel: fit for channel, fit in model["fit_percent"].items() if fit is not None}
    if model["stopped"]:
        return f"{title}: no fit, as the free run stopped early: {model['stopped'].rstrip('.')}.", False
    if not known:
        return f"{title}: no fit, as all channels are constant.", False
    ordered = sorted(known, key=lambda channel: known[channel])
    worst, best = ordered[0], ordered[-1]
    ends = f"{value_text(known[worst])} % ({worst})"
    if len(ordered) > 1:
        ends = f"from {ends} to {value_text(known[best])} % ({best})"
    return f"{title}: fit {ends}; {fit_words(known)}.", FITS[quality(known[worst])]


KIND = Kind("comparison.json", "comparison", _read)
