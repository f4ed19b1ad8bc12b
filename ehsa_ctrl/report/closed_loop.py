"""What a diagnosis does to a closed loop, as a page shows it: metrics before and after, and the closed-loop gap."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..core.unit import factor
from ..scenario.metrics import METRICS
from .number import NOTHING, number, unit

#: Metrics that are shown, where a run has them.
SHOWN = (
    "RiseTime", "SettlingTime", "SettlingRatio", "Overshoot", "SteadyStateError", "MaxError", "RMSError",
    "HuntingAmplitude", "Slips", "SaturationShare", "CurrentRMS", "Energy", "StopTime", "TravelAfterStop",
)  # fmt: skip


#: A logged current that differs by more than this share of its spread from what a controller asks was not its own.
OTHER = 0.2


def closed_table(closed: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Head (the plants) and rows (name, a value a plant, unit) of a closed_loop.json."""
    words = list(closed["plants"])
    rows = []
    for name in SHOWN:
        each, metric = closed["metrics"].get(name), METRICS[name]
        if each is None or all(_missing(each[word]) for word in words):
            continue
        scale = factor(metric.shown, metric.unit)
        cells = (NOTHING if _missing(each[word]) else number(each[word] / scale) for word in words)
        rows.append([name, *cells, unit(metric.shown)])
    replay = closed.get("replay")
    if replay:
        for signal in replay["gap"][words[0]]:
            gaps = (replay["gap"][word][signal] for word in words)
            cells = (NOTHING if _missing(gap) else number(float(f"{100.0 * gap:.3g}")) for gap in gaps)
            rows.append([f"gap in {signal.replace('_', ' ')}", *cells, "%"])
    return [f"{word} plant" for word in words], rows


def _missing(value: float | None) -> bool:
    return value is None or value != value
