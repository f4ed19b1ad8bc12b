"""The page of a fleet: the rigs that changed, and the fleet's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import DOUBT, Kind, Page, Points, Section, Sentence, Table
from ..text import value_text


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    counts, rigs = content["counts"], content["rigs"]
    changed = sorted((rig for rig in rigs if rig["changed"]), key=lambda rig: rig["p"])
    rate = f"{100.0 * content['rate']:g} %"
    words = f"{counts['changed']} of {counts['rigs']} rigs changed, at a false-discovery rate of {rate}."
    sentences: list[Sentence] = [(words, DOUBT if changed else True)]
    if content["failed"]:
        sentences.append((f"{len(content['failed'])} logs could not be used.", DOUBT))
    head = ["rig", "changed in", "since", "kind", "q", "diagnosis"]
    rows = [
        [rig["name"], " or ".join([rig["cause"], *rig["same"]]), rig["since"][:10], rig["kind"],
         value_text(rig["q"], 1.0, 2), (rig["diagnosis"] or {}).get("verdict", "").replace("_", " ")]
        for rig in changed
    ]  # fmt: skip
    blocks: list[Any] = [Table("Changed rigs, the most significant first", head, rows)] if rows else []
    unlike = [[rig["name"], rig["unlike"], value_text(rig["unlike_q"], 1.0, 2)] for rig in rigs if rig["unlike"]]
    if unlike:
        blocks.append(Table("Unlike the fleet from the first log on", ["rig", "in", "q"], unlike))
    parameters = [
        [
            one["name"],
            *(value_text(one[key], 1.0, 4) for key in ("nominal", "mean")),
            value_text(one["mean_sd"], 1.0, 2),
            "not determined" if one["spread"] is None else value_text(one["spread"], 1.0, 2),
            one["unit"],
        ]
        for one in content["parameters"]
    ]
    head = ["parameter", "nominal", "fleet mean", "its sd", "spread between units", "unit"]
    return Page(
        title=f"Fleet of {counts['rigs']} rigs of {content['plant']}",
        sentences=sentences,
        sections=[
            Section("Rigs", blocks, "rigs"),
            Section("Parameters", [Table("Mean of the fleet, spread between units", head, parameters)], "parameters"),
            Section("Logs", [Points([*content["notes"], *content["failed"].values()])], "logs"),
        ],
        facts=[
            ("plant", str(content["plant"])), ("logs", str(counts["logs"])), ("false-discovery rate", rate),
        ],
        versions=content["provenance"],
    )  # fmt: skip


KIND = Kind("fleet.json", "fleet", _read)
