"""Metrics of a run as texts, and their values over the ranges of assumed parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from ...core.text import join_words
from ...core.unit import factor
from ...plant.file import label
from ...scenario.metrics import METRICS
from ..page import Table, mark
from ..text import quantity_in, unit, value_text

Run = Mapping[str, Any]

#: Metrics shown over the ranges of assumed parameters, where a scenario limits none.
UNLIMITED = ("MaxError", "RMSError", "CurrentRMS")


def range_sentence(run: Run) -> tuple[str, bool]:
    """Whether the verdict holds over the ranges of all assumed parameters, in words too."""
    ranges, kept = run["assumed_ranges"], _keeps(run)
    flips = [
        f"{label(each['name'])} = {_end(each, end)}" for each in ranges for end in each["ends"] if end["passed"] != kept
    ]
    words = {True: "kept", False: "not kept"}
    if flips:
        return f"Limits are {words[kept]} with the nominal values, but {words[not kept]} at {join_words(flips)}.", False
    many = f"{len(ranges)} assumed parameter{'s' if len(ranges) != 1 else ''}"
    return f"Limits are {words[kept]} at both ends of the range of each of {many}, as with the nominal values.", True


def _keeps(run: Run) -> bool:
    """Whether the limits are kept with the nominal values; a baseline that differs is not a limit."""
    return bool(run["assumed_ranges"][0].get("kept", run["passed"]))


def _end(each: Mapping[str, Any], end: Mapping[str, Any]) -> str:
    return quantity_in(end["value"], each.get("file_unit", each["unit"]), each["unit"])


def ranges_table(run: Run) -> Table:
    """A row for the nominal values and one for each end of a range."""
    names = [each["metric"] for each in run["limits"]] or list(UNLIMITED)
    names = [name for name in dict.fromkeys(names) if metric_exists(run, name)]
    kept = _keeps(run)
    rows = [["nominal", "", *(metric_of(run, name) for name in names), mark(kept, "kept" if kept else "not kept")]]
    for each in run["assumed_ranges"]:
        for index, end in enumerate(each["ends"]):
            words = "✓ kept" if end["passed"] else f"✗ {'; '.join(end['failures'])}"
            metrics = [metric_text(name, end["metrics"].get(name)) for name in names]
            rows.append([label(each["name"]) if index == 0 else "", _end(each, end), *metrics, words])
    head = ["assumed", "value", *map(metric_heading, names), "limits"]
    return Table("Assumed parameters at the ends of their ranges, one at a time, controller unchanged", head, rows)


def metric_heading(name: str) -> str:
    """Name and unit of a metric above a column, a line a word: SteadyStateError is wider than its numbers."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "\n", name)
    return f"{words}\n{unit(METRICS[name].display_unit)}".rstrip()


def metric_text(name: str, value: float | None, digits: int = 4) -> str:
    """A metric's SI value in the unit that is shown."""
    return value_text(value, factor(METRICS[name].display_unit, METRICS[name].unit), digits)


def metric_of(run: Run, name: str, which: str = "nonlinear", digits: int = 4) -> str:
    if name in run.get("not_defined", {}):
        return "n/a"
    return metric_text(name, (run["metrics"].get(name) or {}).get(which), digits)


def not_defined_sentence(runs: Sequence[Run]) -> str:
    """Metrics that the scenario's reference does not define, with the reason; empty for none."""
    reasons: dict[str, list[str]] = {}
    for name, why in runs[0].get("not_defined", {}).items():
        reasons.setdefault(why, []).append(name)
    return " ".join(f"Not defined, as {why}: {join_words(names)}." for why, names in reasons.items())


def metric_exists(run: Run, name: str) -> bool:
    """Whether a metric has a value in either run."""
    metric = run["metrics"].get(name) or {}
    return any(metric.get(which) is not None for which in ("linear", "nonlinear"))


def bounds_text(limit: Mapping[str, Any]) -> str:
    name = limit["metric"]
    parts = [
        f"{words} {metric_text(name, limit[key])}"
        for words, key in (("at least", "min"), ("at most", "max"))
        if limit[key] is not None
    ]
    return f"{' and '.join(parts)} {unit(METRICS[name].display_unit)}".rstrip()
