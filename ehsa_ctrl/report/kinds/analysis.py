"""The linear model, its loops and the worst of many plants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ...core.text import join_words
from ._margins import MARGINS, margin, margins_table
from ._result import Drawing, Kind, Result, Sentence, Table, written

MARKS = {"good": "✓ good", "fault": "✗ fault"}


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    loops, robust = content.get("loops", []), content.get("robust", [])
    reviews = content.get("reviews", [])
    stems = [(loop["controller"], f"-{loop['controller']}" if len(loops) > 1 else "") for loop in loops]
    drawings = [Drawing("bode", "Bode plot", "From the current to speed, pressure difference, rod speed and position.")]
    for name, end in stems:
        drawings += [
            Drawing(f"loop{end}", f"Loop with {name}", "Thick bars: gain margin (top) and phase margin (middle)."),
            Drawing(f"nyquist{end}", f"Nyquist plot with {name}"),
            Drawing(f"robustness{end}", f"{name} on many plants"),
        ]
    return Result(
        title=f"Analysis of {content['plant']}, {content['model']} model" + _with(loops),
        sentences=_sentences(content, loops, robust, reviews),
        tables=[*_tables(content, loops, robust), *map(_review, reviews)],
        drawings=drawings,
        facts=[("plant", str(content["plant"])), ("model", str(content["model"]))],
    )


def _with(loops: list[Any]) -> str:
    """The controllers of the loops, for the title."""
    names = [str(loop["controller"]) for loop in loops]
    return f", with {join_words(names[:4])}" + (" and more" if len(names) > 4 else "") if names else ""


def _sentences(content: Mapping[str, Any], loops: list[Any], robust: list[Any], reviews: list[Any]) -> list[Sentence]:
    modes = sorted({f"{f / 6.283185307:.3g}" for f in content["natural_frequencies"] if f}, key=float)
    found: list[Sentence] = [(f"Modes at {', '.join(modes)} Hz." if modes else "No mode but an integrator.", None)]
    for loop in loops:
        words = (
            f"{loop['controller']}: crossover {margin(loop, 'crossover')}, phase margin "
            f"{margin(loop, 'phase_margin')}, Ms {margin(loop, 'Ms')}; the closed loop is "
            f"{'stable' if loop['stable'] else 'NOT STABLE'}."
        )
        found.append((words, bool(loop["stable"])))
    for each in robust:
        words = f"{each['controller']} on {each['plants']} plants: " + (
            f"all stable, worst Ms {written(each['worst']['Ms']['value'], 1.0, 3)}."
            if each["stable"]
            else f"NOT STABLE on {len(each['unstable'])} of them."
        )
        found.append((words, bool(each["stable"])))
    for review in reviews:
        look = [each["test"] for each in review["findings"] if each["verdict"] != "good"]
        words = f"Review of {review['controller']}: {'passed' if review['passed'] else 'not passed'}"
        found.append((f"{words}{', to look at: ' + ', '.join(look) if look else ''}.", bool(review["passed"])))
    return found


def _tables(content: Mapping[str, Any], loops: list[Any], robust: list[Any]) -> Iterator[Table]:
    yield Table(
        "Poles",
        ["pole, rad/s", "natural frequency, Hz", "damping"],
        [
            [_complex(pole), written(f, 6.283185307, 3), written(damping, 1.0, 3)]
            for pole, f, damping in zip(
                content["poles"], content["natural_frequencies"], content["damping"], strict=True
            )
        ],
    )
    units = {"speed": "rad/s per A", "dP": "Pa per A", "rod_speed": "m/s per A", "position": "m per A"}
    yield Table(
        "From the current",
        ["to", "DC gain", "unit", "zeros, rad/s"],
        [
            [name, "integrates" if gain is None else written(gain, 1.0, 5), units.get(name, ""),
             ", ".join(map(_complex, content["zeros"][name])) or "none"]
            for name, gain in content["dc_gain"].items()
        ],
    )  # fmt: skip
    if loops:
        yield margins_table("Margins, broken at the current", loops)
    for each in robust:
        if not each["worst"]:
            continue
        yield Table(
            f"{each['controller']}: the worst of each margin among {each['plants']} plants",
            ["margin", "worst", "of half", "unit", "on which plant"],
            [
                [MARGINS[name][0], written(worst["value"], MARGINS[name][2], 3),
                 written(each["quantiles"].get(name, {}).get("50 %"), MARGINS[name][2], 3), MARGINS[name][1],
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
        return written(real)
    return f"{written(real)} {'+' if imaginary > 0 else '−'} {written(abs(imaginary))}i"


KIND = Kind("analysis.json", "analysis", _read)
