"""A baseline: what a scenario gave when somebody looked at it and found it right."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from ..core.definition import Definition, In, Metre, RadianPerSecond, Second
from ..core.errors import InputError
from ..core.files import parse_json, read_text, write_text
from ..core.unit import factor
from .funnel import Tube, tube, worst_exit
from .metrics import METRICS

if TYPE_CHECKING:
    import pandas

    from .result import ScenarioResult
    from .scenario import Scenario

#: Points of a recorded signal, beside those at events; digits that are kept.
POINTS, DIGITS = 500, 6
#: Signals that are recorded: the unit of their tolerance and the unit a person reads.
SIGNALS = {"x": ("m", "mm"), "omega": ("rad/s", "rpm"), "dP": ("Pa", "bar")}
FOLDER = "baselines"


class BaselineTolerances(Definition):
    """[baseline]: tolerances of a run around the recorded one."""

    time: Second = Field(default=0.012, description="time shift, in either direction")
    position: Metre = Field(default=1e-4, description="half height of the position tube")
    speed: RadianPerSecond = Field(default=10.0, description="half height of the speed tube")
    pressure: Annotated[float, In("Pa")] = Field(
        default=2e5, description="half height of the tube of the pressure difference"
    )
    share: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.05,
        description="relative change of a metric, on top of its resolution",
    )

    @model_validator(mode="after")
    def _fit(self) -> BaselineTolerances:
        if min(self.time, self.position, self.speed, self.pressure) < 0:
            raise ValueError("tolerances must be at least 0")
        return self

    def of(self, signal: str) -> float:
        """Tolerance of a recorded signal, SI units."""
        return {"x": self.position, "omega": self.speed, "dP": self.pressure}[signal]


@dataclass(frozen=True)
class Baseline:
    """A recorded run.

    Attributes
    ----------
    path: its file, beside the scenario in the folder `baselines`.
    reason: why it was recorded, in words.
    of: what decided the run, each as a hash: scenario, plant, controller.
    metrics: name -> (linear, nonlinear), nan for what did not happen.
    signals: name -> (M,) of the nonlinear run, with its times under "time".
    """

    path: Path
    reason: str
    of: Mapping[str, str]
    metrics: Mapping[str, tuple[float, float]]
    signals: Mapping[str, np.ndarray]

    def differences(self, result: ScenarioResult) -> tuple[str, ...]:
        """Where a run leaves this baseline, a sentence each; empty if it keeps to it."""
        tolerances = result.scenario.definition.baseline
        found = [*self._metric_differences(result, tolerances.share), *self._signal_differences(result)]
        if found:
            changed = [what for what, mark in marks(result).items() if self.of.get(what) != mark]
            since = f"; changed since then: {', '.join(changed)}" if changed else ""
            found.append(f"the baseline was recorded because: {self.reason}{since}")
        return tuple(found)

    def tube(self, result: ScenarioResult, signal: str) -> Tube:
        """The tube of a recorded signal at the run's times."""
        tolerances = result.scenario.definition.baseline
        return tube(
            self.signals["time"],
            self.signals[signal],
            result.nonlinear.trajectory.time,
            value_tolerance=tolerances.of(signal),
            time_tolerance=tolerances.time,
        )

    def to_pandas(self, result: ScenarioResult) -> pandas.DataFrame:
        """One row a sample of the run: time and, for each signal, its value and the bounds of its tube."""
        import pandas

        run = result.nonlinear.trajectory
        table = {"time": run.time}
        for name in SIGNALS:
            bounds = self.tube(result, name)
            table |= {name: run[name], f"{name}_lower": bounds.lower, f"{name}_upper": bounds.upper}
        return pandas.DataFrame(table)

    def _metric_differences(self, result: ScenarioResult, share: float) -> list[str]:
        found = []
        for name, recorded in self.metrics.items():
            if name not in result.metrics:
                continue
            metric = METRICS[name]
            for word, old, new in zip(("linear", "nonlinear"), recorded, result.metrics[name], strict=True):
                if not metric.close(old, new, share):
                    found.append(f"baseline: {name} ({word}) was {metric.read(old)} and is {metric.read(new)}")
        return found

    def _signal_differences(self, result: ScenarioResult) -> list[str]:
        run = result.nonlinear.trajectory
        found = []
        if run.time[-1] < self.signals["time"][-1] - 1.5 * float(run.time[1]):
            found.append(
                f"baseline: the run ended at {run.time[-1]:g} s, the recorded one at {self.signals['time'][-1]:g} s"
            )
        for name, (unit, shown) in SIGNALS.items():
            left = worst_exit(run.time, run[name], self.tube(result, name))
            if left is not None:
                scale = factor(shown, unit)
                found.append(
                    f"baseline: {name} leaves its tube by {left.by / scale:.3g} {shown} at {left.time:.3f} s, where it "
                    f"is {left.value / scale:.4g} {shown}"
                )
        return found


def baseline_path(result: ScenarioResult) -> Path | None:
    """Where a run's baseline is kept; None for a scenario that has no file."""
    path = result.scenario.path
    return path and path.parent / FOLDER / f"{result.scenario.name}-{result.controller.name}.json"


def baseline_files(scenario: Scenario) -> list[Path]:
    """Baselines of a scenario, whatever the controller; a scenario whose name begins alike has others."""
    if scenario.path is None:
        return []
    files = sorted((scenario.path.parent / FOLDER).glob(f"{scenario.name}-*.json"))
    return [file for file in files if file.is_file()]


def read_baseline(path: Path) -> Baseline:
    """Read a baseline's file. Raises InputError with file and key if it is none."""
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
    if result.other_failures:
        raise InputError(f"{who}: no baseline is recorded of a run that fails ({result.other_failures[0]})")
    run = result.nonlinear.trajectory
    points = _points(result)
    content = {
        "schema": 1,
        "scenario": result.scenario.name,
        "controller": result.controller.name,
        "reason": reason.strip(),
        "of": marks(result),
        "versions": run.provenance,
        "metrics": {
            name: [_rounded(value) if np.isfinite(value) else None for value in pair]
            for name, pair in result.metrics.items()
        },
        "signals": {name: [_rounded(value) for value in run[name][points]] for name in ("time", *SIGNALS)},
    }
    return write_text(path, _text(content))


def differences(result: ScenarioResult) -> tuple[str, ...]:
    """What recording a run would change, in sentences; nothing for one that keeps its baseline or fails otherwise."""
    if result.other_failures:
        return ()
    return result.baseline.differences(result) if result.baseline else ("recorded for the first time",)


def updated(result: ScenarioResult, reason: str) -> tuple[ScenarioResult, tuple[str, ...]]:
    """Record a run that has no baseline or leaves it; returns it with its baseline, and what changes, in sentences.

    A run that keeps to its baseline leaves the file as it is, so that small changes can't add up unseen. One that fails
    otherwise is given back unchanged. Raises InputError as write_baseline does.
    """
    changes = differences(result)
    if not changes:
        return result, ()
    path = write_baseline(result, reason)
    return replace(result, baseline=read_baseline(path)), (*changes, f"written to {path}")


def marks(result: ScenarioResult) -> dict[str, str]:
    """Short hashes of what decides a run: the scenario without its limits and words, the plant, the controller as it
    says itself to be."""
    definition = result.scenario.definition.model_dump(
        mode="json", exclude={"title", "why", "limits", "expect_trips", "baseline", "spread"}
    )
    plant = [
        str(result.plant.structure),
        result.plant.values,
        [str(sensor) for sensor in result.plant.sensors.values()],
    ]
    parts = {"scenario": definition, "plant": plant, "controller": str(result.controller)}
    return {
        name: hashlib.sha256(json.dumps(part, sort_keys=True, default=str).encode()).hexdigest()[:12]
        for name, part in parts.items()
    }


def _points(result: ScenarioResult) -> np.ndarray:
    """Samples to record: evenly spaced ones, the rod's changes between sticking and sliding, jumps, extremes."""
    run = result.nonlinear.trajectory
    even = np.linspace(0, len(run) - 1, min(POINTS, len(run))).round().astype(int)
    switched = np.flatnonzero(np.any(np.diff(run.modes, axis=0) != 0, axis=1))
    jumped = np.flatnonzero((np.diff(result.nonlinear.reference[:, 0]) != 0) & (result.nonlinear.reference[1:, 1] == 0))
    forced = np.flatnonzero(np.diff(run.outer_force) != 0)
    extremes = [int(find(run[name])) for name in SIGNALS for find in (np.argmin, np.argmax)]
    # Of a plant that switches at every other sample not all can be kept.
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
