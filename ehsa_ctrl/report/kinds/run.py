"""Scenarios that were run: verdicts, metrics on the nonlinear plant, and what assumed parameters would change."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.text import join_words
from ...core.unit import factor
from ...scenario.metrics import METRICS
from ...scenario.result import NAMED, first_reasons
from ..number import unit
from ._result import DOUBT, Drawing, Kind, Result, Sentence, Table, written

#: Metrics in the table, where a run has them.
SHOWN = ("SettlingTime", "Overshoot", "SteadyStateError", "MaxError", "RMSError", "Slips", "CurrentRMS")
MARKS = {"pass": "✓ passed", "fail": "✗ failed", "untested": "– untested"}


def _read(content: Mapping[str, Any], folder: Path) -> Result:
    runs = content["scenarios"]
    good = sum(run["passed"] for run in runs)
    names = list(dict.fromkeys(run["scenario"] for run in runs))
    rows = [
        [run["scenario"], run["controller"], MARKS[run["verdict"]], *(_value(run, name) for name in SHOWN)]
        for run in runs
    ]
    head = [f"{name}, {unit(METRICS[name].shown)}".rstrip(", ") for name in SHOWN]
    tables = [Table("On the nonlinear plant", ["scenario", "controller", "verdict", *head], rows)]
    many = [run for run in runs if len(run["failures"]) > NAMED]
    if many:
        reasons = [[run["scenario"], run["controller"], f"✗ {words}"] for run in many for words in run["failures"]]
        tables.append(Table("What failed, all of it", ["scenario", "controller", "limit or recorded run"], reasons))
    swings = [_swing(run, each) for run in runs for each in run.get("assumed_ranges") or ()]
    if swings:
        caption = "Whether limits are kept at the ends of the range in which a parameter is only assumed"
        head = ["scenario", "controller", "parameter", "at", "limits"]
        tables.append(Table(caption, head, [row for rows in swings for row in rows]))
    return Result(
        title=f"{good} of {len(runs)} scenarios passed: {join_words(names[:4])}"
        + (" and more" if len(names) > 4 else ""),
        sentences=_sentences(runs, good),
        tables=tables,
        drawings=[
            Drawing(
                f"{run['scenario']}-{run['controller']}", f"{run['scenario']} with {run['controller']}", run["title"]
            )
            for run in runs
        ],
        facts=[("seeds", ", ".join(dict.fromkeys(str(run["seed"]) for run in runs)))],
        versions=runs[0]["provenance"],
    )


def _sentences(runs: list[Mapping[str, Any]], good: int) -> list[Sentence]:
    failed = [run for run in runs if not run["passed"]]
    found: list[Sentence] = [(f"{_name(run)} failed: {first_reasons(run['failures'])}.", False) for run in failed]
    if not failed:
        found.append(("Every scenario kept its limits on the nonlinear plant.", True))
    flips = [
        f"{_name(run)} ({join_words(each['name'] for each in run['assumed_ranges'] if each['flips'])})"
        for run in runs
        if any(each["flips"] for each in run.get("assumed_ranges") or ())
    ]
    if flips:
        found.append(
            (f"Verdicts that an assumed parameter decides within its believed range: {'; '.join(flips)}.", DOUBT)
        )
    return found


def _name(run: Mapping[str, Any]) -> str:
    return f"{run['scenario']} with {run['controller']}"


def _value(run: Mapping[str, Any], name: str) -> str:
    if name in run.get("not_defined", {}):
        return "not defined"
    metric = METRICS[name]
    return written(run["metrics"].get(name, {}).get("nonlinear"), factor(metric.shown, metric.unit))


def _swing(run: Mapping[str, Any], each: Mapping[str, Any]) -> list[list[str]]:
    return [
        [run["scenario"], run["controller"], each["name"], f"{written(end['value'])} {unit(each['unit'])}".rstrip(),
         "✓ kept" if end["passed"] else f"✗ {'; '.join(end['failures'])}"]
        for end in each["ends"]
    ]  # fmt: skip


KIND = Kind("results.json", "scenarios", _read, own=True)
