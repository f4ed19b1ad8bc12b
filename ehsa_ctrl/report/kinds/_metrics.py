"""Metrics of a run as text, and their values at the ends of the ranges of assumed parameters."""

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

#: Metrics in the table of assumed parameters for a scenario without limits.
UNLIMITED = ("MaxError", "RMSError", "CurrentRMS")


def range_sentence(run: Run) -> tuple[str, bool]:
    """A sentence on the limits at the ends of all ranges of assumed parameters, and whether the verdict holds there."""
    ranges, nominal = run["assumed_ranges"], _nominal_passed(run)
    flips = [
        f"{label(each['name'])} = {_end(each, end)}"
        for each in ranges
        for end in each["ends"]
        if end["passed"] != nominal
    ]
    words = {True: "met", False: "violated"}
    if flips:
        return (
            f"Limits are {words[nominal]} at the nominal values but {words[not nominal]} at {join_words(flips)}.",
            False,
        )
    many = f"all {len(ranges)} assumed parameters" if len(ranges) > 1 else "the assumed parameter"
    return f"Limits are {words[nominal]} at the nominal values and at both ends of the range of {many}.", True


def _nominal_passed(run: Run) -> bool:
    """Whether the limits are met at the nominal values; a deviation from the baseline does not count."""
    return bool(run["assumed_ranges"][0].get("kept", run["passed"]))


def _end(each: Mapping[str, Any], end: Mapping[str, Any]) -> str:
    return quantity_in(end["value"], each.get("file_unit", each["unit"]), each["unit"])


def ranges_table(run: Run) -> Table:
    """Metrics and limits: one row for the nominal values and one per end of a range."""
    names = [each["metric"] for each in run["limits"]] or list(UNLIMITED)
    names = [name for name in dict.fromkeys(names) if metric_exists(run, name)]
    passed = _nominal_passed(run)
    rows = [["nominal", "", *(metric_of(run, name) for name in names), mark(passed, "met" if passed else "violated")]]
    for each in run["assumed_ranges"]:
        for index, end in enumerate(each["ends"]):
            words = "✓ met" if end["passed"] else f"✗ {'; '.join(end['failures'])}"
            metrics = [metric_text(name, end["metrics"].get(name)) for name in names]
            rows.append([label(each["name"]) if index == 0 else "", _end(each, end), *metrics, words])
    head = ["assumed", "value", *map(metric_heading, names), "limits"]
    return Table("Assumed parameters at the ends of their ranges, one at a time, same controller", head, rows)


def metric_heading(name: str) -> str:
    """Column heading of a metric: name and unit, one word per line, as SteadyStateError is wider than its numbers."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "\n", name)
    return f"{words}\n{unit(METRICS[name].display_unit)}".rstrip()


def metric_text(name: str, value: float | None, digits: int = 4) -> str:
    """A metric [SI unit] in its display unit."""
    return value_text(value, factor(METRICS[name].display_unit, METRICS[name].unit), digits)


def metric_of(run: Run, name: str, which: str = "nonlinear", digits: int = 4) -> str:
    if name in run.get("not_defined", {}):
        return "n/a"
    return metric_text(name, (run["metrics"].get(name) or {}).get(which), digits)


def not_defined_sentence(runs: Sequence[Run]) -> str:
    """The metrics that are undefined for the scenario's reference, with the reason; empty if all are defined."""
    reasons: dict[str, list[str]] = {}
    for name, why in runs[0].get("not_defined", {}).items():
        reasons.setdefault(why, []).append(name)
    return " ".join(f"Not defined because {why}: {join_words(names)}." for why, names in reasons.items())


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
