"""Parameters that were identified from logs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.text import join_words, unique_names
from ...identification.comparison import fit_words, quality
from ...plant.file import both
from ..number import uncertain, unit
from ._result import DOUBT, FITS, Drawing, Kind, Result, Sentence, Table, fit_table, percent, settings_of, written


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    models = content.get("models") or {content["model"]: content}
    sentences: list[Sentence] = []
    tables: list[Table] = []
    drawings: list[Drawing] = []
    for model, each in models.items():
        end = f"-{model}" if len(models) > 1 else ""
        sentences += _sentences(model, each)
        tables += _tables(model, each)
        drawings += [
            Drawing(f"fit{end}", f"Before and after, {model} model", "Free runs, driven by the logged drive alone."),
            Drawing(f"parameters{end}", f"Parameters, {model} model"),
            Drawing(f"residuals{end}", f"Residuals, {model} model"),
        ]
    return Result(
        title=f"Identification of {content['plant']} from {_logs(content)}",
        sentences=sentences,
        tables=tables,
        drawings=drawings,
        facts=[
            *settings_of({**content, "model": ""}),
            ("logs used", join_words(map(str, content["logs"]["train"]))),
            ("held out", join_words(map(str, content["logs"]["validate"])) or "none"),
            ("written", str(content.get("written", ""))),
        ],
        versions=content["provenance"],
    )


def _logs(content: Mapping[str, Any]) -> str:
    """Names of the logs that were used; of many their number."""
    names = unique_names([str(log) for log in content["logs"]["train"]])
    return join_words(names) if 0 < len(names) < 4 else f"{len(names)} logs"


def _sentences(model: str, each: Mapping[str, Any]) -> list[Sentence]:
    parameters = each["parameters"]
    poor = [both(name) for name, p in parameters.items() if not p["identifiable"]]
    words = f"{model} model: {len(parameters) - len(poor)} of {len(parameters)} parameters well determined"
    found: list[Sentence] = [(f"{words}{'; not ' + join_words(poor) if poor else ''}.", True if not poor else DOUBT)]
    fits = each["fit_percent"]
    held = {name: fit for name, fit in (fits.get("validate") or fits["train"]).items() if fit is not None}
    if held:
        worst = min(held, key=lambda name: held[name])
        where = "a held-out log" if fits.get("validate") else "the logs used, none was held out"
        words = f"The worst fit on {where} is {written(held[worst])} % ({worst}): {fit_words(held)}."
        found.append((words, FITS[quality(held[worst])]))
    found += [(f"{words.rstrip('.')}.", DOUBT) for words in each["warnings"]]
    if each["interrupted"]:
        found.append(("The search was interrupted: this is the best that it had.", DOUBT))
    return found


def _tables(model: str, each: Mapping[str, Any]) -> list[Table]:
    rows = []
    for name, p in each["parameters"].items():
        sd = float("inf") if p["sd"] is None else p["sd"]
        relative = percent(sd / abs(p["value"]), 2) if p["value"] and p["sd"] is not None else "–"
        mark = "✓" if p["identifiable"] else "✗"
        rows.append([both(name), uncertain(p["value"], sd), relative, written(p["start"]), unit(p["unit"]),
                     f"{mark} {p['verdict']}"])  # fmt: skip
    head = ["name", "value, one sd", "relative", "start", "unit", "verdict"]
    fits = each["fit_percent"]
    columns = {}
    for key, words in (("train", "used"), ("validate", "held out")):
        if fits.get(key):
            columns[f"{words}, before"] = fits.get("before", {}).get(key) or {}
            columns[f"{words}, after"] = fits[key]
    return [Table(f"Parameters, {model} model", head, rows),
            fit_table(f"Fit in free run, %, {model} model", columns)]  # fmt: skip


KIND = Kind("identification.json", "identification", _read, own=True)
