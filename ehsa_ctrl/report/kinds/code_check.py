"""The page of exported code: word lengths, error, operations and stack."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import DOUBT, Kind, Page, Paragraph, Section, Sentence, Table
from ..text import value_text

#: Number in C -> words.
NUMBERS = {
    "double": "doubles",
    "float": "floats",
    "int32_t": "fixed point in words of 32 bits",
    "int16_t": "fixed point in words of 16 bits",
}


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    runs, signals, operations = content["runs"], content["signals"], content["operations"]
    worst = max(runs, key=lambda name: _size(runs[name]["error"]))
    fixed = signals["current"]["step"] is not None
    error = value_text(runs[worst]["error"], 1e-3, 3)
    usable = bool(content["usable"])
    unit = f"m{content.get('unit', 'A')}"
    drive = "current" if unit == "mA" else "drive"
    tolerance = f"accepted are {value_text(content['tolerance'], 1e-3, 3)} {unit}"
    sentences: list[Sentence] = [
        (
            f"{'Usable' if usable else 'Not usable'}: the {drive} differs by at most {error} {unit} from that of "
            f"Python in doubles, in {worst}; {tolerance}.",
            usable,
        )
    ]
    unsolved = sum(one["unsolved"] for one in runs.values())
    if any(one["iterations"] is not None for one in runs.values()):
        most = max(one["iterations"] or 0 for one in runs.values())
        sentences.append(
            (f"The solver takes at most {most} iterations in a sample; {unsolved} samples are unsolved.", not unsolved)
        )
    full = [name for name, one in signals.items() if one["headroom"] is not None and one["headroom"] < 0.0]
    if full:
        sentences.append((f"Beyond their scale, so that they saturate: {', '.join(full)}.", DOUBT))
    kinds = ", ".join(f"{count} {kind}" for kind, count in operations.items() if kind != "flops")
    what = "operations on the longest way through a sample" if fixed else "flops in the costliest sample"
    stack = "unknown to this compiler" if content["stack"] is None else f"{content['stack']} bytes"
    return Page(
        title=f"C code of {content['controller']} in {NUMBERS.get(content['number'], content['number'])}",
        sentences=sentences,
        sections=[
            Section(
                "Word length" if fixed else "Signals",
                [_signals(signals, fixed=fixed), *([Paragraph(SCALES)] if fixed else [])],
                "signals",
            ),
            Section("Runs", [_runs(runs, unit)], "runs"),
        ],
        facts=[
            ("cost", f"{operations['flops']} {what} ({kinds})"),
            ("worst-case stack", f"{stack}, without the mathematical library's own"),
        ],
    )


SCALES = (
    "The last bit is the step of a signal's scale, the headroom the bits between its largest magnitude and the end of "
    "the scale, where it saturates."
)


def _size(error: float | None) -> float:
    """For JSON, infinity is None."""
    return float("inf") if error is None else error


def _signals(signals: Mapping[str, Any], *, fixed: bool) -> Table:
    head = ["signal", "largest\nSI", "error\nSI", *(["last bit\nSI", "headroom\nbits"] if fixed else [])]
    rows = []
    for name, one in signals.items():
        row = [name, value_text(one["largest"], 1.0, 3), value_text(one["error"], 1.0, 3)]
        rows.append([*row, *([value_text(one["step"], 1.0, 3), value_text(one["headroom"], 1.0, 2)] if fixed else [])])
    return Table("Signals over all runs: largest magnitude, and largest difference from Python", head, rows)


def _runs(runs: Mapping[str, Any], unit: str) -> Table:
    solver = any(one["iterations"] is not None for one in runs.values())
    head = ["run", "samples", f"error\n{unit}", *(["iterations", "unsolved"] if solver else [])]
    rows = []
    for name, one in runs.items():
        row = [name, str(one["samples"]), value_text(one["error"], 1e-3, 3)]
        rows.append([*row, *([value_text(one["iterations"]), str(one["unsolved"])] if solver else [])])
    return Table("Every run replayed by the compiled code: largest difference", head, rows)


KIND = Kind("check.json", "exported code", _read)
