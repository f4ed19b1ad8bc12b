"""A controller that was designed from a specification."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ._margins import margin, margins_table
from ._result import Drawing, Kind, Result, Sentence, percent, written


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    loop = content["loop"]
    asked = ", ".join(f"{key} {value}" for key, value in content["asked"].items())
    sentences: list[Sentence] = [
        (f"{str(content['law']).rstrip('.')}.", None),
        (
            f"The linear closed loop is {'stable' if loop['stable'] else 'NOT STABLE'}: crossover "
            f"{margin(loop, 'crossover')}, phase margin {margin(loop, 'phase_margin')}, Ms {margin(loop, 'Ms')}, delay "
            f"margin {margin(loop, 'delay_margin')}.",
            bool(loop["stable"]),
        ),
        (
            f"A step of the target: overshoot {percent(content['overshoot'])}, settled after "
            f"{written(content['settling_time'], 1e-3)} ms, on the linear model; ehsa-ctrl run checks it on the plant "
            "with friction.",
            None,
        ),
    ]
    settings = ", ".join(f"{key} = {value}" for key, value in content["settings"].items())
    return Result(
        title=f"Design for {content['plant']}: {content['kind']}",
        sentences=sentences,
        tables=[margins_table("Margins, broken at the current", [loop])],
        drawings=[
            Drawing("step", "Step of the target", "Linear model and controller; friction is not in it."),
            Drawing("loop", "Open loop", "Thick bars: gain margin (top) and phase margin (middle)."),
            Drawing("nyquist", "Nyquist plot"),
        ],
        facts=[
            ("asked for", asked or "nothing in particular"),
            ("set for this run", settings or "nothing"),
            ("controller", str(content["controller"] or "printed only")),
        ],
    )


KIND = Kind("design.json", "design", _read)
