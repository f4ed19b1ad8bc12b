"""Files of a scored set."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict
from pathlib import Path

from answer_score import AnswerScore
from calibration import reliability
from figures import Figure
from score_statistics import confusion


def table(figures: dict[str, list[Figure]]) -> str:
    lines = []
    for heading, rows in figures.items():
        lines += ["", f"**{heading}**", "", "| | value | 95 % interval | cases |", "|---|---|---|---|"]
        lines += [row.text() for row in rows]
    return "\n".join(lines[1:])


def write(
    rows: list[AnswerScore],
    figures: dict[str, list[Figure]],
    failures: str,
    folder: Path,
) -> None:
    """score.md, score.json, failures.md, cases.csv, reliability.csv and confusion.csv beside the answers."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "score.md").write_text(table(figures) + "\n")
    plain = {heading: [asdict(f) for f in part] for heading, part in figures.items()}
    (folder / "score.json").write_text(json.dumps(plain, indent=1) + "\n")
    (folder / "failures.md").write_text(failures + "\n")
    with (folder / "reliability.csv").open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["from", "to", "mean_probability", "share_of_causes", "low", "high", "count"])
        for b in reliability(rows):
            shares = (b.mean, b.present.value, b.present.low, b.present.high)
            writer.writerow([b.low, b.high, *(f"{value:.4g}" for value in shares), b.present.count])
    with (folder / "cases.csv").open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        shown = (
            "name", "family", "verdict", "truth", "laws", "largest", "answer", "first", "top_1", "in_set", "set_size",
            "found", "listed", "missed", "wrong", "minor", "on_truth", "closed", "closable", "seconds",
        )  # fmt: skip
        writer.writerow(shown)
        for row in rows:
            cells = [getattr(row, name) for name in shown]
            writer.writerow([" + ".join(c) if isinstance(c, tuple) else c for c in cells])
    down, across, counts = confusion(rows)
    with (folder / "confusion.csv").open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["truth \\ answer", *across])
        writer.writerows([id, *map(int, row)] for id, row in zip(down, counts, strict=True))
