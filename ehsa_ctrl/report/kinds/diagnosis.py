"""Why a log and the simulation differ; with it what changed since an earlier log, and what it does to a closed loop."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from ...core.files import read_json
from ...core.text import join_words
from ...diagnosis.diagnosis import MODELS
from ...diagnosis.signals import SIGNALS
from ...plant.file import both
from ..closed_loop import closed_table
from ..number import uncertain, unit
from ._result import DOUBT, Drawing, Kind, Result, Sentence, Table, percent, written

#: Whether one can go on with a verdict.
STATES: dict[str, bool | Literal["doubt"]] = {
    "no_gap": True, "effect": True, "ambiguous": DOUBT, "underdetermined": DOUBT
}  # fmt: skip
#: What JSON has null for.
INFINITE = float("inf")


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    sentences: list[Sentence] = [(content["sentence"], STATES.get(content["verdict"], False))]
    if "change" in content:
        sentences.insert(0, (content["change"], None))
    if content["next_experiment"]:
        sentences.append((f"Next: {content['next_experiment']}", None))
    sentences += [(f"Doubtful in the log: {str(words).rstrip('.')}.", DOUBT) for words in content["findings"]]
    tables = [_causes(content)] if content["effects"] else []
    tables.append(_gaps(content))
    closed = folder / "closed_loop.json"
    facts = [
        (
            "where, over the whole log",
            join_words(f"{w['place']} {percent(w['share'], 2)}" for w in content["where"] if w["share"] >= 0.01),
        )
    ]
    if closed.is_file():
        found = read_json(closed)
        head, rows = closed_table(found)
        name = f"{found['scenario']} with {found['controller']}"
        tables.append(Table(f"What it does to the closed loop: {name}", ["", *head, "unit"], rows))
        for word, reasons in found["failures"].items():
            said = "; ".join(reasons) if reasons else "keeps the limits"
            sentences.append((f"{name} on the {word} plant: {said}.", not reasons))
    return Result(
        title=f"Diagnosis of {_log(content)}",
        sentences=sentences,
        tables=tables,
        drawings=[
            Drawing("signals", "Measured and simulated", "Free runs, driven by what was logged of the drive alone."),
            Drawing("where", "Where the gap lies"),
            Drawing("unknown_inputs", "What the balances lack"),
            Drawing("candidates", "Candidates by evidence"),
            Drawing("shrinkage", "How far the gap shrinks"),
            Drawing("closed_loop", "The closed loop before and after"),
        ],
        facts=[
            *(facts if content["where"] else []),
            ("held out", str(content["held_out"])),
            ("a gap matters from", f"{percent(content['threshold'])} on"),
            ("it took", f"{written(content['seconds'], 1.0, 2)} s, {content['runs']} simulations"),
        ],
        versions=content["provenance"],
    )


def _log(content: Mapping[str, Any]) -> str:
    """Log and plant, as far as the file says them."""
    files = [Path(name) for name in (content.get("rests_on") or {}).get("files", {})]
    log = Path(content["log"]).name if content.get("log") else next((f.name for f in files if f.suffix != ".toml"), "")
    plant = content.get("plant") or next((file.stem for file in files if file.suffix == ".toml"), "")
    return f"{log or 'a log'}{f' on {plant}' if plant else ''}"


def _causes(content: Mapping[str, Any]) -> Table:
    rows = []
    for cause in content["effects"]:
        name = cause["id"] + (f" ({cause['channel']})" if cause["channel"] else "")
        said = {
            both(key): f"{uncertain(p['value'], INFINITE if p['sd'] is None else p['sd'])} {unit(p['unit'])}".rstrip()
            for key, p in cause["parameters"].items()
        }
        numbers = "; ".join(f"{key} = {words}" for key, words in said.items())
        rows.append([name, numbers, ", ".join(cause["ambiguous_with"]) or "–", written(cause["probability"], 1.0, 2),
                     percent(cause["gap_closed"])])  # fmt: skip
    return Table("Causes", ["cause", "numbers", "or, not told apart", "probability", "closes"], rows)


def _gaps(content: Mapping[str, Any]) -> Table:
    gaps = content["gap"]
    models = [model for model in gaps if model in MODELS]
    rows = [
        [name.replace("_", " "), *(percent(gaps[model].get(name), 2) for model in models)]
        for name in (*SIGNALS, "total")
        if name in gaps["nominal"]
    ]
    return Table("Gap on held-out data", ["signal", *(MODELS[model] for model in models)], rows)


KIND = Kind("diagnosis.json", "diagnosis", _read, page="diagnosis.html", own=True)
