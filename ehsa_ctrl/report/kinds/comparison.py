"""A log beside free runs of a plant."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...identification.comparison import fit_words, quality
from ._result import DOUBT, FITS, Drawing, Kind, Result, Sentence, fit_table, settings_of, written


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    models = content["models"]
    sentences: list[Sentence] = []
    for name, model in models.items():
        known = {channel: fit for channel, fit in model["fit_percent"].items() if fit is not None}
        if model["stopped"] or not known:
            why = model["stopped"].rstrip(".") or "no channel moved"
            sentences.append((f"{name} model: no fit is given, {why}.", False))
            continue
        ordered = sorted(known, key=lambda channel: known[channel])
        worst, best = ordered[0], ordered[-1]
        ends = f"from {written(known[worst])} % ({worst}) to {written(known[best])} % ({best})"
        words = f"{name} model: the fit is {ends}: {fit_words(known)}."
        sentences.append((words, FITS[quality(known[worst])]))
    sentences += [(f"Doubtful in the log: {_words(finding)}.", DOUBT) for finding in content["findings"]]
    return Result(
        title=f"Comparison of {Path(str(content['log'])).name} with {content['plant']}",
        sentences=sentences,
        tables=[fit_table("Fit in free run, %", {name: model["fit_percent"] for name, model in models.items()})],
        drawings=[Drawing("compare", "Measured and simulated", "Free runs, driven by the logged drive alone.")],
        facts=[
            *settings_of({**content, "model": ""}),
            ("log", str(content["log"])),
            ("time", f"{written(content['from'])} to {written(content['to'])} s"),
        ],
        versions=content["provenance"],
    )


def _words(finding: Any) -> str:
    return str(finding["sentence"]).rstrip(".") if isinstance(finding, dict) else str(finding)


KIND = Kind("comparison.json", "comparison", _read, own=True)
