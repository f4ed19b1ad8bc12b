"""A run of the virtual bench."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ._result import DOUBT, Drawing, Kind, Result, Sentence, settings_of, written

#: A pressure level that moved by more than this [Pa] is said.
DRIFT = 1e5


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    seconds = (content["samples"] - 1) * content["sample_time"]
    stopped, passed = content["stopped"], content["limits_passed"]
    ran: Sentence = (f"Ran for {written(seconds)} s, to the end of its input.", True)
    if stopped:
        ran = (f"Ended after {written(seconds)} s, before its input: {stopped.rstrip('.')}.", False)
    sentences = [ran]
    sentences += [(f"Passed a limit of the plant: {words}.", DOUBT) for words in passed]
    if not passed:
        sentences.append(("Passed no limit of the plant.", True))
    drift = content["pressure_level_drift"]
    if abs(drift) > DRIFT:
        sentences.append(
            (f"The pressure level moved by {written(drift, 1e5, 2)} bar: the model conserves volume.", None)
        )
    return Result(
        title=f"Simulation of {content['plant']}" + (f" with {content['input']}" if content.get("input") else ""),
        sentences=sentences,
        drawings=[Drawing("simulation", "The run", "Grey bars: shaft or rod sticks.")],
        facts=[
            *settings_of(content),
            ("samples", f"{content['samples']}, {written(content['sample_time'], 1e-3)} ms apart"),
            ("seed", str(content["seed"])),
            ("log", str(content["log"])),
        ],
        versions=content["provenance"],
    )


KIND = Kind("simulation.json", "simulation", _read)
