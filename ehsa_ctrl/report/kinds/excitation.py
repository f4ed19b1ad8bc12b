"""The page of a proposed experiment."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.text import join_words
from ...plant.file import label
from ...simulation.limits import SHOWN, scale_of
from ..page import DOUBT, Kind, Page, Picture, Section, Sentence, Table, mark
from ..text import as_sentence, percent, unit, value_text
from ._tables import settings_of

#: Candidate inputs listed in the table.
LISTED = 12


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    parameters = content["parameters"]
    poor = [name for name, each in parameters.items() if each["verdict"] != "well determined"]
    determined = f"{len(parameters) - len(poor)} of {len(parameters)} parameters are expected to be well determined"
    worst = max(parameters, key=lambda name: parameters[name]["relative_sd"] or float("inf"))
    kept: Sentence = ("The plant's file has no limits, so none were checked.", DOUBT)
    if content["limits"]:
        nearest = max(content["limits"], key=lambda name: content["limits"][name]["worst_share"])
        kept = (
            f"The plant's limits are kept even with parameter errors of {percent(content['variations']['spread'], 2)}; "
            f"the closest is {nearest.replace('_', ' ')}, at most "
            f"{percent(content['limits'][nearest]['worst_share'], 2)} of which is used.",
            True,
        )
    sentences: list[Sentence] = [
        (as_sentence(f"{content['input']}, for {value_text(content['duration'])} s"), None),
        (f"{determined}{'; not ' + join_words(map(label, poor)) if poor else ''}. The least certain is {label(worst)}, "
         f"with a relative standard deviation of {percent(parameters[worst]['relative_sd'])}.",
         True if not poor else DOUBT),
        kept,
    ]  # fmt: skip
    return Page(
        title=f"Proposed experiment for {content['plant']}",
        sentences=sentences,
        sections=[Section("Input", [
            Picture("excitation", "Input and expected response"),
            Table(
                "Expected accuracy of the parameters",
                ["name", "nominal", "expected sd", "relative sd", "worst case", "unit", "verdict"],
                [
                    [label(name), value_text(p["believed"]), value_text(p["sd"], 1.0, 2), percent(p["relative_sd"], 2),
                     percent(p["relative_sd_at_worst"], 2), unit(p["unit"]),
                     mark(p["verdict"] == "well determined", p["verdict"])]
                    for name, p in parameters.items()
                ],
            ),
            Table(
                f"Plant limits; worst case of {content['variations']['draws']} random plants",
                ["limit", "allowed", "reached", "worst case", "unit"],
                [_limit(name, each) for name, each in content["limits"].items()],
            ),
            Table(
                "Candidate inputs, scored by the largest relative sd of a parameter",
                ["input", "score", "parameters\nnot determined"],
                [
                    [each["input"], percent(each["score"], 2), str(each["not_determined"])]
                    for each in content["candidates"][:LISTED]
                ],
            ),
        ], "input")],
        facts=[
            *settings_of(content),
            ("seed", str(content["seed"])),
            ("current", str(content["current"] or "not written")),
            *(("next step", line) for line in content["next"]),
        ],
        versions=content["provenance"],
    )  # fmt: skip


def _limit(name: str, each: Mapping[str, Any]) -> list[str]:
    scale = scale_of(name, each["unit"]) if name in SHOWN else 1.0
    values = (value_text(each[key], scale) for key in ("allowed", "reached", "worst"))
    words = "distance from mid-stroke" if name == "stroke" else name.replace("_", " ")
    return [words, *values, unit(SHOWN.get(name, each["unit"]))]


KIND = Kind("excitation.json", "experiment", _read)
