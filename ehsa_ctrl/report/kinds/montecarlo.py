"""How likely a scenario passes on plants that are not known exactly."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...plant.file import both
from ._result import DOUBT, Drawing, Kind, Result, Sentence, Table, percent, written

#: Of the parameters that decide, so many are listed.
LISTED = 12


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    campaigns = content["campaigns"]
    sentences = [sentence for campaign in campaigns for sentence in _sentences(campaign)]
    names = ", ".join(dict.fromkeys(f"{each['scenario']}" for each in campaigns))
    drawings = []
    for each in campaigns:
        longer = f"{each['scenario']}-{each['controller']}"
        stem = longer if any((folder / f"{longer}{end}").exists() for end in (".svg", ".png")) else each["scenario"]
        words = "What decides: where the drawn parameters lie in runs that pass and in runs that fail."
        drawings.append(Drawing(stem, f"{each['scenario']} with {each['controller']}", words))
    return Result(
        title=f"Monte Carlo: {names} on many plants",
        sentences=sentences,
        tables=[table for each in campaigns for table in _tables(each)],
        drawings=drawings,
        facts=[("seed", ", ".join(dict.fromkeys(str(each["seed"]) for each in campaigns)))],
        versions=campaigns[0]["provenance"],
    )


def _sentences(each: Mapping[str, Any]) -> list[Sentence]:
    low, high = each["interval"]
    found: list[Sentence] = [
        (
            f"{each['scenario']} with {each['controller']}: {each['passes']} of {each['runs']} runs pass, probability "
            f"{written(each['probability'], 1.0, 3)} ({percent(each['confidence'])} interval {written(low, 1.0, 3)} to "
            f"{written(high, 1.0, 3)}).",
            None,
        ),
        _demand(each),
    ]
    decisive = [both(item["name"]) for item in each["influences"] if item["decisive"]]
    if decisive:
        found.append((f"What decides: {', '.join(decisive)}, the strongest first.", None))
    if each["interrupted"]:
        found.append(("Interrupted: there are fewer runs than were asked for.", DOUBT))
    return found


def _demand(each: Mapping[str, Any]) -> Sentence:
    """The lower end of the interval against what is demanded; a share alone is neither good nor bad."""
    required, low = each.get("required"), each["interval"][0]
    if required is None:
        return "No probability was demanded of it, so that nothing is judged here.", None
    words = "shown" if low >= required else "not shown"
    start = f"the interval begins at {written(low, 1.0, 3)}"
    return f"Demanded is a probability of at least {written(required)}: {words}, {start}.", low >= required


def _tables(each: Mapping[str, Any]) -> list[Table]:
    name = f"{each['scenario']} with {each['controller']}"
    tables = []
    if each["failures"]:
        rows = [[word, str(count)] for word, count in each["failures"].items()]
        tables.append(Table(f"{name}: what failed", ["limit", "runs"], rows))
    if each["influences"]:
        rows = [
            [both(item["name"]), written(item["value"], 1.0, 2), written(item["chance"], 1.0, 2),
             written(item["passing"]), written(item["failing"]), "yes" if item["decisive"] else "no"]
            for item in each["influences"][:LISTED]
        ]  # fmt: skip
        head = ["parameter", "strength, -1 to 1", "by chance", "median, passing", "median, failing", "decisive"]
        tables.append(Table(f"{name}: what decides", head, rows))
    if each["uncertain"]:
        tables.append(Table(f"{name}: what was drawn", ["parameter"], [[words] for words in each["uncertain"]]))
    return tables


KIND = Kind("montecarlo.json", "Monte Carlo campaign", _read)
