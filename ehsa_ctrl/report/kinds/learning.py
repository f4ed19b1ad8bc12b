"""The page of a reference that was learnt over several runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import Facts, Kind, Page, Picture, Section, Sentence, Table
from ..text import value_text


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    trials = content["trials"]
    first, best = trials[0], min(trials, key=lambda one: float(one["rms"]))
    sentences: list[Sentence] = [
        (
            f"RMS error {_um(first)} without a correction, {_um(best)} in the best trial, {best['number']}, "
            f"{_um(trials[-1])} in the last.",
            None,
        ),
        (
            f"On the linear loop each trial leaves at most {value_text(content['contraction'], 1.0, 3)} of what the "
            f"correction still lacks, most at {value_text(content['contraction_at'], 1.0, 3)} Hz.",
            None,
        ),
    ]
    rows = [
        [
            str(one["number"]),
            value_text(one["rms"], 1e-6, 3),
            value_text(one["largest"], 1e-6, 3),
            value_text(one["correction"], 1e-6, 3),
            value_text(one["current"], 1.0, 3),
        ]
        for one in trials
    ]
    head = ["trial", "RMS error\num", "largest error\num", "largest correction\num", "RMS current\nA"]
    caption = "Above: error of each trial. Below: error of the first and the last trial over time."
    facts = [
        ("gain", value_text(content["gain"])),
        ("lead", f"{content['lead']} samples"),
        ("cutoff", f"{value_text(content['cutoff'])} Hz"),
    ]
    return Page(
        title=f"Learning: {content['scenario']} with {content['controller']}",
        sentences=sentences,
        sections=[
            Section("Trials", [Picture("learning", "Learning", caption), Table("Every trial", head, rows)]),
            Section("Settings", [Facts(facts)]),
        ],
        versions=content["provenance"],
    )


def _um(trial: Mapping[str, Any]) -> str:
    return f"{value_text(trial['rms'], 1e-6, 3)} um"


KIND = Kind("learning.json", "learning", _read)
