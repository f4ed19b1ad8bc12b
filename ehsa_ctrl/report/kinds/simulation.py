"""The page of a simulation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import DOUBT, Kind, Page, Picture, Section, Sentence
from ..text import as_sentence, value_text
from ._charts import charted, simulation_chart
from ._tables import settings_of

#: A drift of the mean pressure beyond this [Pa] is reported: 5 % of the EHSA's rest pressure (engineering judgement).
DRIFT = 1e5


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    seconds = (content["samples"] - 1) * content["sample_time"]
    stopped, passed = content["stopped"], content["limits_passed"]
    completion: Sentence = (f"The simulation ran for {value_text(seconds)} s, to the end of its input.", True)
    if stopped:
        words = f"The simulation stopped after {value_text(seconds)} s, before the end of its input: "
        completion = (f"{words}{stopped.rstrip('.')}.", False)
    sentences = [completion]
    sentences += [(f"Plant limit exceeded: {words}.", DOUBT) for words in passed]
    if not passed:
        sentences.append(("No plant limit was exceeded.", True))
    sentences += [(as_sentence(words), DOUBT) for words in content.get("warnings", [])]
    # The linear model has no dry friction.
    caption = "Grey bars: shaft or rod sticks." if content.get("model") != "linear" else ""
    drift = content["pressure_level_drift"]
    # A system without pressures has none.
    if drift is not None and abs(drift) > DRIFT:
        words = f"The mean pressure drifted by {value_text(drift, 1e5, 2)} bar"
        sentences.append((f"{words}, because the model (12) conserves volume instead of oil mass.", None))
    pictures = [Picture("simulation", "Simulated run", caption)]
    return Page(
        title=f"Simulation of {content['plant']}" + (f" with {content['input']}" if content.get("input") else ""),
        sentences=sentences,
        sections=[Section("Simulated run", charted(simulation_chart(folder, content, pictures), pictures), "run")],
        facts=[
            *settings_of(content),
            ("samples", f"{content['samples']}, {value_text(content['sample_time'], 1e-3)} ms apart"),
            ("seed", str(content["seed"])),
            ("log", str(content["log"])),
        ],
        versions=content["provenance"],
    )


KIND = Kind("simulation.json", "simulation", _read)
