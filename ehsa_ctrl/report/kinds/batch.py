"""The page of the diagnoses of several logs: one table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.text import folder_names, unique_names
from ..page import DOUBT, FileLink, Kind, Page, Section, Sentence, Table
from ..text import percent, value_text
from .diagnosis import KIND as DIAGNOSIS


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    logs = content["logs"]
    files = [row["file"] for row in logs]
    named = list(zip(unique_names(files), logs, strict=True))
    counts = ", ".join(f"{count} {str(word).replace('_', ' ')}" for word, count in content["counts"].items())
    sentences: list[Sentence] = [(f"{len(logs)} logs: {counts}.", None)]
    sentences += [
        (f"{name} could not be diagnosed: {row['error'].rstrip('.')}.", False) for name, row in named if row["error"]
    ]
    if content["interrupted"]:
        sentences.append(("Interrupted: some logs have not been diagnosed.", DOUBT))
    rows = [
        [_page(row, place, name), row["verdict"].replace("_", " ") or "✗ failed", _causes(row), row["place"],
         value_text(row["probability"], 1.0, 2) if row["cause"] else "", percent(row["gap_before"], 2),
         percent(row["gap_after"], 2) if row["verdict"] != "no_gap" else "", value_text(row["seconds"], 1.0, 2)]
        for (name, row), place in zip(named, folder_names(files), strict=True)
    ]  # fmt: skip
    head = ["log", "verdict", "causes", "place", "probability", "gap", "gap with\ncauses", "time\ns"]
    return Page(
        title=f"Diagnosis of {len(logs)} logs of {content['plant']}",
        sentences=sentences,
        sections=[
            Section(
                "Logs",
                [Table("Total gap on held-out data, of the nominal model and with the causes", head, rows)],
                "logs",
            )
        ],
        facts=[("plant", str(content["plant"])), ("relevant gap", f"{percent(content['threshold'])} or more")],
        versions=content["provenance"],
        covers=folder_names(files),
    )


def _page(row: Mapping[str, Any], place: str, name: str) -> str:
    """A log's name, as a link to its own page, which it has unless it could not be diagnosed."""
    return name if row["error"] else FileLink(name, (Path(place) / DIAGNOSIS.page).as_posix())


def _causes(row: Mapping[str, Any]) -> str:
    """All causes of a log, each with those that explain it as well."""
    return " + ".join(" or ".join(one) for one in row.get("causes") or [row["set"]])


KIND = Kind("summary.json", "diagnoses", _read)
