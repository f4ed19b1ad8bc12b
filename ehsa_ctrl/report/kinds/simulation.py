"""The page of a simulation on the virtual bench."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import DOUBT, Kind, Page, Picture, Section, Sentence
from ..text import value_text
from ._tables import settings_of

#: A drift of the pressure level beyond this [Pa] is reported.
DRIFT = 1e5


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    seconds = (content["samples"] - 1) * content["sample_time"]
    stopped, passed = content["stopped"], content["limits_passed"]
    ran: Sentence = (f"Ran for {value_text(seconds)} s, to the end of its input.", True)
    if stopped:
        ran = (f"Ended after {value_text(seconds)} s, before its input: {stopped.rstrip('.')}.", False)
    sentences = [ran]
    sentences += [(f"Passed a limit of the plant: {words}.", DOUBT) for words in passed]
    if not passed:
        sentences.append(("Passed no limit of the plant.", True))
    drift = content["pressure_level_drift"]
    if abs(drift) > DRIFT:
        sentences.append(
            (f"The pressure level drifted by {value_text(drift, 1e5, 2)} bar: the model conserves volume.", None)
        )
    return Page(
        title=f"Simulation of {content['plant']}" + (f" with {content['input']}" if content.get("input") else ""),
        sentences=sentences,
        sections=[Section("The run", [Picture("simulation", "The run", "Grey bars: shaft or rod sticks.")], "run")],
        facts=[
            *settings_of(content),
            ("samples", f"{content['samples']}, {value_text(content['sample_time'], 1e-3)} ms apart"),
            ("seed", str(content["seed"])),
            ("log", str(content["log"])),
        ],
        versions=content["provenance"],
    )


KIND = Kind("simulation.json", "simulation", _read)
