"""Baseline files: one JSON per scenario and controller, in the folder `baselines` beside the scenario."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.files import parse_json, read_text, write_text
from .baseline import SIGNALS, Baseline, Predictability, recorded_of, run_hashes

if TYPE_CHECKING:
    from .definition import Scenario
    from .result import ScenarioResult

FOLDER = "baselines"
#: Number of evenly spaced points of a recorded signal, to which events are added, and significant digits written
#: (engineering judgement: files stay small, and rounding is far below the tolerances).
POINTS, DIGITS = 500, 6
#: Between the points, the recorded signal is linear. More points are added until it differs from the run by at most
#: this share of the tube's half height (engineering judgement).
LINEAR_ERROR = 0.25


def baseline_path(result: ScenarioResult) -> Path | None:
    """Path of a run's baseline file; None for a scenario without a file."""
    path = result.scenario.path
    return path and path.parent / FOLDER / f"{result.scenario.name}-{result.controller.name}.json"


def baseline_files(scenario: Scenario) -> list[Path]:
    """Baseline files of a scenario with any controller.

    The list may include files of other scenarios whose names start with this one's and a hyphen.
    """
    if scenario.path is None:
        return []
    files = sorted((scenario.path.parent / FOLDER).glob(f"{scenario.name}-*.json"))
    return [file for file in files if file.is_file()]


def read_baseline(path: Path) -> Baseline:
    """Read a baseline file. Raises InputError with file and reason if it is invalid."""
    try:
        content = parse_json(read_text(path))
        metrics = {
            name: tuple(np.nan if v is None else float(v) for v in pair) for name, pair in content["metrics"].items()
        }
        signals = {
            name: np.array(content["signals"][name], dtype=float)
            for name in ("time", *SIGNALS)
            if name in content["signals"]
        }
        if len({values.shape for values in signals.values()}) != 1 or any(len(pair) != 2 for pair in metrics.values()):
            raise ValueError("signals must have the same length and metrics two values each")
        return Baseline(
            path, str(content["reason"]), dict(content["of"]), metrics, signals,  # type: ignore[arg-type]
            _read_predictability(content.get("predictable", {})),
        )  # fmt: skip
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise InputError(
            f"{path}: is not a valid baseline ({type(error).__name__}: {error}); delete it and record it again with "
            "--update-baselines"
        ) from None


def write_baseline(result: ScenarioResult, reason: str) -> Path:
    """Record a run as the baseline of its scenario and controller, and return the path.

    Raises
    ------
    InputError: no reason, a scenario without a file, a run that violates a limit, or a folder that is not writable.
    """
    path = baseline_path(result)
    name = f"{result.scenario.name} with {result.controller.name}"
    if path is None:
        raise InputError(
            f"{name}: the scenario has no file beside which the baseline could be stored; load it from a file"
        )
    if not reason.strip():
        raise InputError(f"{name}: no reason given; state why the baseline changes (--reason TEXT)")
    if result.limit_failures:
        raise InputError(f"{name}: a run that fails can't become a baseline ({result.limit_failures[0]})")
    from .predictability import predictability

    run = result.nonlinear.trajectory
    points = _sample_indices(result)
    left = predictability(result)
    content = {
        "schema": 1,
        "scenario": result.scenario.name,
        "controller": result.controller.name,
        "reason": reason.strip(),
        "of": run_hashes(result),
        "versions": run.provenance,
        "metrics": {
            name: [_round(value) if np.isfinite(value) else None for value in pair]
            for name, pair in result.metrics.items()
        },
        "signals": {name: [_round(value) for value in run[name][points]] for name in ("time", *recorded_of(run))},
    }
    if left != Predictability():
        spread = {name: _round(value) if np.isfinite(value) else None for name, value in left.spread.items()}
        content["predictable"] = {"until": _round(left.until) if np.isfinite(left.until) else None, "spread": spread}
    return write_text(path, _format(content))


def _read_predictability(content: Mapping[str, Any]) -> Predictability:
    """The key `predictable` of a file; null stands for infinity."""
    until, spread = content.get("until"), content.get("spread", {})
    return Predictability(
        np.inf if until is None else float(until),
        {name: np.inf if value is None else float(value) for name, value in spread.items()},
    )


def baseline_changes(result: ScenarioResult) -> tuple[str, ...]:
    """Changes that recording a run would make, as sentences; empty if it matches its baseline or violates a limit."""
    if result.limit_failures:
        return ()
    return result.baseline.differences(result) if result.baseline else ("recorded for the first time",)


def update_baseline(result: ScenarioResult, reason: str) -> tuple[ScenarioResult, tuple[str, ...]]:
    """Record a run that has no baseline or deviates from it; return the updated result and the changes as sentences.

    A run within the tolerances leaves the file unchanged, so that small changes can't accumulate unnoticed. A run that
    violates a limit is returned unchanged. Raises InputError as `write_baseline` does.
    """
    changes = baseline_changes(result)
    if not changes:
        return result, ()
    baseline = read_baseline(write_baseline(result, reason))
    until = baseline.predictable.until
    told = [f"rounding decides after {until:g} s; signals are compared up to there"] if np.isfinite(until) else []
    return replace(result, baseline=baseline), (*changes, *told, f"written to {baseline.path}")


def _sample_indices(result: ScenarioResult) -> np.ndarray:
    """Indices of the samples to record: evenly spaced ones, stick-slip transitions, jumps, extremes."""
    run = result.nonlinear.trajectory
    even = np.linspace(0, len(run) - 1, min(POINTS, len(run))).round().astype(int)
    transitions = np.flatnonzero(np.any(np.diff(run.modes, axis=0) != 0, axis=1))
    reference = result.nonlinear.reference
    jumps = np.flatnonzero((np.diff(reference[:, 0]) != 0) & (reference[1:, 1] == 0))
    force_steps = np.flatnonzero(np.diff(run.outer_force) != 0)
    extremes = [int(find(run[name])) for name in recorded_of(run) for find in (np.argmin, np.argmax)]
    # Contacts may switch at every other sample.
    transitions = transitions[:: max(transitions.size // POINTS, 1)]
    events = np.concatenate([transitions, jumps[:POINTS], force_steps])
    points = np.unique(np.concatenate([even, events, events + 1, extremes]))
    tolerances = result.scenario.definition.baseline
    for name in recorded_of(run):
        points = _refined(run.time, run[name], points, LINEAR_ERROR * tolerances.of(name))
    return points


def _refined(time: np.ndarray, values: np.ndarray, points: np.ndarray, tolerance: float) -> np.ndarray:
    """Indices with those added that keep a signal (N,) within `tolerance` of the lines between them.

    The worst sample of each line is added until none is too far off (U. Ramer, "An iterative procedure for the
    polygonal approximation of plane curves", Computer Graphics and Image Processing 1, 1972).
    """
    while True:
        error = np.abs(values - np.interp(time, time[points], values[points]))
        lines = np.searchsorted(points, np.arange(time.size), side="right")
        # Per line its worst sample: sorted by line and error, the last of each line.
        order = np.lexsort((error, lines))
        worst = order[np.append(np.diff(lines[order]) != 0, True)]
        added = worst[error[worst] > tolerance]
        if not added.size:
            return points
        points = np.union1d(points, added)


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _format(content: Mapping[str, Any]) -> str:
    """JSON with one line per signal and per metric, so that a diff shows each change as one line."""
    lines = []
    for key, value in content.items():
        if isinstance(value, dict):
            inner = [f"    {json.dumps(name)}: {json.dumps(item)}" for name, item in value.items()]
            lines.append(f"  {json.dumps(key)}: {{\n" + ",\n".join(inner) + "\n  }")
        else:
            lines.append(f"  {json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
