"""Tables and facts shared by several kinds of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.text import unique_names
from ...plant.file import label
from ..page import DOUBT, Points, Section, State, Table
from ..text import NOTHING, value_text

#: Key of a margin in JSON -> name, display unit, SI value of that unit, and meaning.
MARGINS = {
    "crossover": ("crossover", "Hz", 2 * np.pi, "frequency at which the loop gain is 1"),
    "phase_margin": ("phase margin", "°", 1.0, "additional lag at the crossover that makes the loop unstable"),
    "gain_margin": ("gain margin", "", 1.0, "factor on the gain that makes the loop unstable"),
    "delay_margin": ("delay margin", "ms", 1e-3, "additional delay that makes the loop unstable"),
    "Ms": ("Ms", "", 1.0, "peak of |S|: largest amplification of a disturbance"),
    "Mt": ("Mt", "", 1.0, "peak of |T|: largest amplification of reference and noise"),
    "disk_margin": ("disk margin", "", 1.0, "size of the disk of simultaneous gain and phase variations"),
    "current_noise": ("current from sensor noise, RMS", "mA", 1e-3, "RMS current that the sensors' noise causes"),
}


#: Quality of a fit -> state of its sentence.
FITS: dict[str, State] = {"good": True, "fair": DOUBT, "poor": False}


def margin(loop: Mapping[str, Any], key: str) -> str:
    """A margin with its unit."""
    _, unit, scale, _ = MARGINS[key]
    return f"{value_text(loop[key], scale, 3)} {unit}".rstrip().replace(" °", "°")


def margins_table(caption: str, loops: Sequence[Mapping[str, Any]]) -> Table:
    """One row per margin, one column per controller."""
    rows = [
        [words, *(value_text(loop.get(key), scale) for loop in loops), unit, meaning]
        for key, (words, unit, scale, meaning) in MARGINS.items()
        if any(loop.get(key) is not None for loop in loops)
    ]
    return Table(caption, ["margin", *(str(loop["controller"]) for loop in loops), "unit", "meaning"], rows)


def loop_sentence(loop: Mapping[str, Any]) -> str:
    """Margins and stability of a loop as a sentence."""
    return (
        f"crossover {margin(loop, 'crossover')}, phase margin {margin(loop, 'phase_margin')}, gain margin "
        f"{margin(loop, 'gain_margin')}, delay margin {margin(loop, 'delay_margin')}, Ms {margin(loop, 'Ms')}, Mt "
        f"{margin(loop, 'Mt')}; the linear closed loop is {'stable' if loop['stable'] else 'NOT STABLE'}."
    )


def fit_table(caption: str, columns: Mapping[str, Mapping[str, float | None]]) -> Table:
    """Fits in percent: one row per channel, one column per run."""
    channels = dict.fromkeys(channel for fits in columns.values() for channel in fits)
    rows = [[channel, *map(fit_text, (fits.get(channel) for fits in columns.values()))] for channel in channels]
    return Table(caption, ["channel", *columns], rows)


def fit_text(percent: float | None) -> str:
    """A fit in percent to a tenth; differences below that mean nothing."""
    return NOTHING if percent is None else f"{percent:.1f}"


def settings_of(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Plant and the parameters set for this run, as facts."""
    given = ", ".join(f"{label(key)} = {value}" for key, value in content.get("settings", {}).items())
    plant = str(content.get("plant", ""))
    model = content.get("model")
    return [("plant", f"{plant} ({model})" if model else plant), ("parameters set", given or "none")]


def findings_section(findings: Sequence[Any]) -> Section:
    """Findings about the quality of the logs; empty without findings."""
    return Section("Data quality", [Points([each["sentence"] for each in findings])] if findings else [], "findings")


def steps_of(content: Mapping[str, Any]) -> list[str]:
    """How the logs were read and prepared, as sentences; sentences about reading contain the name of the log."""
    steps = content.get("preparation") or []
    logs = unique_names([str(step.get("log", "")) for step in steps])
    prefixed = ["log" in step and step["kind"] not in ("read", "caution") for step in steps]
    words = [str(step["words"]) for step in steps]
    return [f"{log}: {text}" if prefix else text for log, text, prefix in zip(logs, words, prefixed, strict=True)]


def plant_name(content: Mapping[str, Any]) -> str:
    """The plant's name; of a file, its stem."""
    name = str(content["plant"])
    return Path(name).stem if name.endswith(".toml") else name
