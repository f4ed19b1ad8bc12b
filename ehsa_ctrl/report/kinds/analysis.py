"""The page of an analysis: the linear model, its control loops and their worst case over several plants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ...core.text import join_words
from ...core.unit import factor
from ..page import Kind, Page, Picture, Section, Sentence, Table
from ..text import value_text
from ._tables import MARGINS, loop_sentence, margins_table

#: Output in the JSON -> its words, SI unit and display unit, as in the Bode plot.
OUTPUTS = {
    "speed": ("speed", "rad/s", "rad/s"),
    "dP": ("pressure difference", "Pa", "bar"),
    "rod_speed": ("rod speed", "m/s", "mm/s"),
    "position": ("position", "m", "mm"),
    "angle": ("angle", "rad", "rad"),
}
MARKS = {"good": "✓ good", "fault": "✗ fault"}


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    loops, robust = content.get("loops", []), content.get("robust", [])
    reviews = content.get("reviews", [])
    sections = []
    for loop in loops:
        name, end = loop["controller"], f"-{loop['controller']}" if len(loops) > 1 else ""
        blocks: list[Any] = [
            Picture(
                f"loop{end}", f"Bode plot with {name}", "Thick bars: gain margin (top) and phase margin (middle).", True
            ),
            Picture(f"nyquist{end}", f"Nyquist plot with {name}", headed=True),
            Picture(f"robustness{end}", f"Robustness of {name}", headed=True),
        ]
        sections.append(Section(f"Loop with {name}", blocks))
    tables = [*([margins_table("Margins, loop opened at the current", loops)] if loops else []), *_worst(robust)]
    return Page(
        title=f"Analysis of {content['plant']}, {content['model']} model" + _with(loops),
        sentences=_sentences(content, loops, robust, reviews),
        sections=[
            Section("Linear model", [*_model(content)], "model"),
            Section("Margins", tables, "margins"),
            Section("Review", [*map(_review, reviews)], "review"),
            *sections,
        ],
        facts=[("plant", str(content["plant"])), ("model", str(content["model"]))],
    )


def _with(loops: list[Any]) -> str:
    """The controllers of the loops, for the title."""
    names = [str(loop["controller"]) for loop in loops]
    return f", with {join_words(names[:4])}" + (" and more" if len(names) > 4 else "") if names else ""


def _sentences(content: Mapping[str, Any], loops: list[Any], robust: list[Any], reviews: list[Any]) -> list[Sentence]:
    modes = sorted({f"{f / 6.283185307:.3g}" for f in content["natural_frequencies"] if f}, key=float)
    found: list[Sentence] = [(f"Modes at {join_words(modes)} Hz." if modes else "No mode except an integrator.", None)]
    for loop in loops:
        words = f"{loop['controller']}: {loop_sentence(loop)}"
        found.append((words, bool(loop["stable"])))
    for each in robust:
        words = f"{each['controller']} on {each['plants']} plants: " + (
            f"all stable, worst Ms {value_text(each['worst']['Ms']['value'], 1.0, 3)}."
            if each["stable"]
            else f"NOT STABLE on {len(each['unstable'])} of them."
        )
        found.append((words, bool(each["stable"])))
    for review in reviews:
        doubtful = [each["test"] for each in review["findings"] if each["verdict"] != "good"]
        words = f"Review of {review['controller']}: {'passed' if review['passed'] else 'not passed'}"
        found.append((f"{words}{'; to check: ' + ', '.join(doubtful) if doubtful else ''}.", bool(review["passed"])))
    return found


def _model(content: Mapping[str, Any]) -> Iterator[Any]:
    drive = content.get("drive", {"input": "current", "unit": "A"})
    source = "the current" if drive["input"] == "current" else drive["input"]
    shown = join_words([OUTPUTS[name][0] for name in content["dc_gain"]])
    yield Picture("bode", "Bode plot", f"From {source} to {shown}.")
    yield Table(
        "Poles",
        ["pole, rad/s", "natural frequency, Hz", "damping"],
        [
            [_complex(pole), value_text(f, 6.283185307, 3), value_text(damping, 1.0, 3)]
            for pole, f, damping in zip(
                content["poles"], content["natural_frequencies"], content["damping"], strict=True
            )
        ],
    )
    rows = []
    for name, gain in content["dc_gain"].items():
        words, si, usual = OUTPUTS[name]
        zeros = ", ".join(map(_complex, content["zeros"][name])) or "none"
        rows.append(
            [words, "∞" if gain is None else value_text(gain, factor(usual, si)), f"{usual} per {drive['unit']}", zeros]
        )
    yield Table(f"Transfer functions from {source}", ["output", "DC gain", "unit", "zeros, rad/s"], rows)


def _worst(robust: list[Any]) -> Iterator[Table]:
    """Worst case and median of each margin over several plants."""
    for each in robust:
        if not each["worst"]:
            continue
        yield Table(
            f"{each['controller']}: worst margins over {each['plants']} plants",
            ["margin", "worst", "median", "unit", "worst plant"],
            [
                [MARGINS[name][0], value_text(worst["value"], MARGINS[name][2], 3),
                 value_text(each["quantiles"].get(name, {}).get("50 %"), MARGINS[name][2], 3), MARGINS[name][1],
                 worst["plant"]]
                for name, worst in each["worst"].items() if name in MARGINS
            ],
        )  # fmt: skip


def _review(review: Mapping[str, Any]) -> Table:
    rows = [
        [each["test"], MARKS.get(each["verdict"], f"△ {each['verdict']}"), each["result"],
         "" if each["verdict"] == "good" else each["fix"]]
        for each in review["findings"]
    ]  # fmt: skip
    return Table(f"Review of {review['controller']}", ["test", "verdict", "result", "what to do"], rows)


def _complex(pole: list[float] | float) -> str:
    real, imaginary = pole if isinstance(pole, list) else (pole, 0.0)
    if abs(imaginary) < 1e-9 * max(abs(real), 1.0):
        return value_text(real)
    return f"{value_text(real)} {'+' if imaginary > 0 else '-'} {value_text(abs(imaginary))}i"


KIND = Kind("analysis.json", "analysis", _read)
