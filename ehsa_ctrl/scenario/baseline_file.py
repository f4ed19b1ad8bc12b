"""Files of baselines: one JSON for each scenario and controller, in the folder `baselines` beside the scenario."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.files import parse_json, read_text, write_text
from .baseline import SIGNALS, Baseline, run_hashes

if TYPE_CHECKING:
    from .definition import Scenario
    from .result import ScenarioResult

FOLDER = "baselines"
#: Evenly spaced points of a recorded signal; events are added. Digits that are written.
POINTS, DIGITS = 500, 6


def baseline_path(result: ScenarioResult) -> Path | None:
    """File of a run's baseline; None for a scenario without a file."""
    path = result.scenario.path
    return path and path.parent / FOLDER / f"{result.scenario.name}-{result.controller.name}.json"


def baseline_files(scenario: Scenario) -> list[Path]:
    """Baselines of a scenario with any controller; names that only begin with the scenario's may be among them."""
    if scenario.path is None:
        return []
    files = sorted((scenario.path.parent / FOLDER).glob(f"{scenario.name}-*.json"))
    return [file for file in files if file.is_file()]


def read_baseline(path: Path) -> Baseline:
    """Read the file of a baseline. Raises InputError with file and reason if it is none."""
    try:
        content = parse_json(read_text(path))
        metrics = {
            name: tuple(np.nan if v is None else float(v) for v in pair) for name, pair in content["metrics"].items()
        }
        signals = {name: np.array(content["signals"][name], dtype=float) for name in ("time", *SIGNALS)}
        if len({values.shape for values in signals.values()}) != 1 or any(len(pair) != 2 for pair in metrics.values()):
            raise ValueError("signals must have the same length and metrics two values each")
        return Baseline(path, str(content["reason"]), dict(content["of"]), metrics, signals)  # type: ignore[arg-type]
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise InputError(
            f"{path}: is no baseline ({type(error).__name__}: {error}); delete it and record it again with "
            "--update-baselines"
        ) from None


def write_baseline(result: ScenarioResult, reason: str) -> Path:
    """Record a run as the baseline of its scenario and controller and return its path.

    Raises
    ------
    InputError: no reason, a scenario without a file, a run that fails otherwise, or a folder that can't be written.
    """
    path = baseline_path(result)
    who = f"{result.scenario.name} with {result.controller.name}"
    if path is None:
        raise InputError(f"{who}: the scenario has no file beside which a baseline could be kept")
    if not reason.strip():
        raise InputError(f"{who}: say why the baseline changes (--reason TEXT)")
    if result.limit_failures:
        raise InputError(f"{who}: no baseline is recorded of a run that fails ({result.limit_failures[0]})")
    run = result.nonlinear.trajectory
    points = _points(result)
    content = {
        "schema": 1,
        "scenario": result.scenario.name,
        "controller": result.controller.name,
        "reason": reason.strip(),
        "of": run_hashes(result),
        "versions": run.provenance,
        "metrics": {
            name: [_rounded(value) if np.isfinite(value) else None for value in pair]
            for name, pair in result.metrics.items()
        },
        "signals": {name: [_rounded(value) for value in run[name][points]] for name in ("time", *SIGNALS)},
    }
    return write_text(path, _text(content))


def baseline_changes(result: ScenarioResult) -> tuple[str, ...]:
    """What recording a run would change, in sentences; empty if it agrees with its baseline or fails its limits."""
    if result.limit_failures:
        return ()
    return result.baseline.differences(result) if result.baseline else ("recorded for the first time",)


def update_baseline(result: ScenarioResult, reason: str) -> tuple[ScenarioResult, tuple[str, ...]]:
    """Record a run without baseline, or one that deviates from it; returns it and the changes in sentences.

    A run within the tolerances leaves the file as it is, so that small changes can't accumulate unseen. A run that
    fails its limits is returned unchanged. Raises InputError as write_baseline does.
    """
    changes = baseline_changes(result)
    if not changes:
        return result, ()
    path = write_baseline(result, reason)
    return replace(result, baseline=read_baseline(path)), (*changes, f"written to {path}")


def _points(result: ScenarioResult) -> np.ndarray:
    """Samples to record: evenly spaced ones, changes between sticking and sliding, jumps, extremes."""
    run = result.nonlinear.trajectory
    even = np.linspace(0, len(run) - 1, min(POINTS, len(run))).round().astype(int)
    switched = np.flatnonzero(np.any(np.diff(run.modes, axis=0) != 0, axis=1))
    jumped = np.flatnonzero((np.diff(result.nonlinear.reference[:, 0]) != 0) & (result.nonlinear.reference[1:, 1] == 0))
    forced = np.flatnonzero(np.diff(run.outer_force) != 0)
    extremes = [int(find(run[name])) for name in SIGNALS for find in (np.argmin, np.argmax)]
    # A plant may switch at every other sample.
    switched = switched[:: max(switched.size // POINTS, 1)]
    events = np.concatenate([switched, jumped[:POINTS], forced])
    return np.unique(np.concatenate([even, events, events + 1, extremes]))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _text(content: Mapping[str, Any]) -> str:
    """JSON in which every signal and every metric is one line, so that a change shows as a changed line."""
    lines = []
    for key, value in content.items():
        if isinstance(value, dict):
            inner = [f"    {json.dumps(name)}: {json.dumps(item)}" for name, item in value.items()]
            lines.append(f"  {json.dumps(key)}: {{\n" + ",\n".join(inner) + "\n  }")
        else:
            lines.append(f"  {json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
