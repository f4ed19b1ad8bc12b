"""The page of a controller that was designed from a specification."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import Kind, Page, Picture, Section, Sentence
from ..text import as_sentence, percent, value_text
from ._tables import loop_sentence, margins_table


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    loop = content["loop"]
    asked = ", ".join(f"{key} {value}" for key, value in content["asked"].items())
    settings = ", ".join(f"{key} = {value}" for key, value in content["settings"].items())
    sentences: list[Sentence] = [
        (as_sentence(str(content["law"])), None),
        (f"Linear loop: {loop_sentence(loop)}", bool(loop["stable"])),
        (
            f"Reference step on the linear model: overshoot {percent(content['overshoot'])}, settling time "
            f"{value_text(content['settling_time'], 1e-3)} ms; ehsa-ctrl run checks the controller on the plant with "
            "friction.",
            None,
        ),
    ]
    return Page(
        title=f"Design for {content['plant']}: {content['kind']}",
        sentences=sentences,
        sections=[
            Section(
                "Linear loop",
                [
                    Picture("step", "Reference step", "Linear model and controller, without friction.", True),
                    Picture("loop", "Open loop", "Thick bars: gain margin (top) and phase margin (middle).", True),
                    Picture("nyquist", "Nyquist plot", headed=True),
                    margins_table("Margins, loop opened at the current", [loop]),
                ],
                "loop",
            )
        ],
        facts=[
            ("specification", asked or "none"),
            ("parameters set", settings or "none"),
            ("controller", str(content["controller"] or "not written to a file")),
        ],
    )


KIND = Kind("design.json", "design", _read)
