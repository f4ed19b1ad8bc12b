"""The page of a Monte Carlo campaign: the probability that a scenario passes on uncertain plants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ...plant.file import label
from ...scenario.metrics import METRICS
from ..page import DOUBT, Kind, Page, Paragraph, Picture, Points, Section, Sentence, Table, anchors
from ..text import percent, value_text

#: Parameters listed in the table of influences.
LISTED = 12


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    campaigns = content["campaigns"]
    sentences = [sentence for campaign in campaigns for sentence in _sentences(campaign)]
    names = ", ".join(dict.fromkeys(f"{each['scenario']}" for each in campaigns))
    keys = anchors(_name(each) for each in campaigns)
    return Page(
        title=f"Monte Carlo campaign: {names} on uncertain plants",
        sentences=sentences,
        sections=[Section(_name(each), _blocks(each, folder), key) for each, key in zip(campaigns, keys, strict=True)],
        facts=[("seed", ", ".join(dict.fromkeys(str(each["seed"]) for each in campaigns)))],
        versions=campaigns[0]["provenance"],
    )


def _sentences(each: Mapping[str, Any]) -> list[Sentence]:
    low, high, share = (value_text(value, 1.0, 3) for value in (*each["interval"], each["probability"]))
    found: list[Sentence] = [
        (
            f"{each['scenario']} with {each['controller']}: {each['passes']} of {each['runs']} runs pass, probability "
            f"{share} ({percent(each['confidence'])} confidence interval {low} to {high}).",
            None,
        ),
        _requirement_sentence(each),
    ]
    decisive = [label(item["name"]) for item in each["influences"] if item["decisive"]]
    if decisive:
        found.append((f"Decisive parameters, the strongest first: {', '.join(decisive)}.", None))
    if each.get("worst"):
        found.append((_worst_sentence(each["worst"]), None))
    if each["interrupted"]:
        found.append(("Interrupted: fewer runs than requested.", DOUBT))
    return found


def _worst_sentence(worst: Mapping[str, Any]) -> str:
    """Which draw came out worst."""
    drawn = ", ".join(f"{label(name)} = {value_text(value)}" for name, value in worst["parameters"].items())
    outcome = "passes" if worst["passed"] else f"fails: {'; '.join(worst['failures'])}"
    return f"The worst run, {worst['run']} (sensor noise {worst['seed']}; {drawn or 'no parameter drawn'}), {outcome}."


def _requirement_sentence(each: Mapping[str, Any]) -> Sentence:
    """Whether the lower end of the interval reaches the required probability; no verdict without a requirement."""
    required, low = each.get("required"), each["interval"][0]
    if required is None:
        return "No required probability was given, so there is no verdict.", None
    words = "confirm" if low >= required else "do not confirm"
    start = f"the confidence interval starts at {value_text(low, 1.0, 3)}"
    return f"The runs {words} the required probability of {value_text(required)}: {start}.", low >= required


def _name(each: Mapping[str, Any]) -> str:
    return f"{each['scenario']} with {each['controller']}"


def _blocks(each: Mapping[str, Any], folder: Path) -> list[Any]:
    longer = f"{each['scenario']}-{each['controller']}"
    stem = longer if any((folder / f"{longer}{end}").exists() for end in (".svg", ".png")) else each["scenario"]
    words = (
        "Margin of each run to the limits nearest to violation, over the most influential parameters. Below zero (grey)"
        " the limit is violated; triangles lie below the panel. The ring marks the worst run."
    )
    blocks: list[Any] = [Picture(stem, _name(each), words)]
    blocks += _margins(each)
    if each["influences"]:
        # A rank correlation has no medians: too few runs pass or fail.
        medians = {"passing": "median\npassing", "failing": "median\nfailing"}
        medians = {} if each["influences"][0].get("measure") == "rank" else medians
        rows = [
            [label(item["name"]), value_text(item["value"], 1.0, 2), value_text(item["chance"], 1.0, 2),
             *(value_text(item[key]) for key in medians), "yes" if item["decisive"] else "no"]
            for item in each["influences"][:LISTED]
        ]  # fmt: skip
        measure = "distance of the distributions\n0 to 1" if medians else "rank correlation with the margin\n-1 to 1"
        caption = "Influence of the parameters on passing" + ("; medians in SI units" if medians else "")
        blocks.append(Table(caption, ["parameter", measure, "p-value", *medians.values(), "decisive"], rows))
    if each["uncertain"]:
        blocks += [Paragraph("Uncertain parameters:"), Points(each["uncertain"])]
    return blocks


def _margins(each: Mapping[str, Any]) -> Iterator[Table]:
    """Margins to the limits, and the number of runs for each reason of failure that is not a limit of the scenario."""
    found = each.get("margins", [])
    rows = [
        [row["metric"], METRICS[row["metric"]].format_bounds(row["lower"], row["upper"]),
         *(percent(row[key], 2) for key in ("median", "low", "smallest")),
         f"run {row['run']}", str(row["violated"])]
        for row in found
    ]  # fmt: skip
    head = [
        "metric",
        "limit",
        "median\nmargin",
        "5 % of runs\nare below",
        "smallest\nmargin",
        "in",
        "runs that\nviolate it",
    ]
    yield Table("Margins relative to the limits; below 0 % the limit is violated", head, rows)
    others = {word: count for word, count in each["failures"].items() if word not in {row["metric"] for row in found}}
    yield Table("Other reasons of failure", ["reason", "runs"], [[word, str(count)] for word, count in others.items()])


KIND = Kind("montecarlo.json", "Monte Carlo campaign", _read)
