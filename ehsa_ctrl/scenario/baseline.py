"""Baselines: a recorded run of a scenario, and the comparison of a new run with it.

Metrics are compared with a tolerance. Signals must stay inside a tube: the area that a rectangle, half as wide as the
time tolerance and half as high as the value tolerance, covers when its centre follows the recorded line. A signal may
thus be a little early or late, and a little high or low, and a steep flank is no stricter than a flat part. Tools for
regression of simulations compare in the same way (funnel of the Lawrence Berkeley National Laboratory; csv-compare of
the Modelica Association).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from ..core.definition import Definition, In, Metre, RadianPerSecond, Second
from ..core.errors import InputError
from ..core.files import parse_json, read_text, write_text
from ..core.unit import factor
from .metrics import METRICS

if TYPE_CHECKING:
    import pandas

    from .definition import Scenario
    from .result import ScenarioResult

#: Evenly spaced points of a recorded signal; events are added. Digits that are written.
POINTS, DIGITS = 500, 6
#: Recorded signals: SI unit and the unit in messages.
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


class TubeExit(NamedTuple):
    """Where a signal is farthest outside its tube: time [s], value, distance beyond the bound."""

    time: float
    value: float
    by: float


class Tube(NamedTuple):
    """Lower and upper bound (N,) of a signal at given times."""

    lower: np.ndarray
    upper: np.ndarray

    def worst_exit(self, at: np.ndarray, values: np.ndarray) -> TubeExit | None:
        """The sample farthest outside the tube; None if all are inside."""
        beyond = np.maximum(values - self.upper, self.lower - values)
        k = int(np.argmax(beyond))
        return TubeExit(float(at[k]), float(values[k]), float(beyond[k])) if beyond[k] > 0.0 else None


def signal_tube(
    time: np.ndarray, recorded: np.ndarray, at: np.ndarray, *, value_tolerance: float, time_tolerance: float
) -> Tube:
    """Tube around a line of recorded points, exact at the times `at` (N,).

    Parameters
    ----------
    time, recorded: (M,) increasing times [s] and values; the value is held before the first and after the last point.
    value_tolerance, time_tolerance: half height, in the signal's unit, and half width [s] of the rectangle.
    """
    early, late = at - time_tolerance, at + time_tolerance
    ends = np.interp(early, time, recorded), np.interp(late, time, recorded)
    upper, lower = np.maximum(*ends), np.minimum(*ends)
    first, stop = np.searchsorted(time, early, side="left"), np.searchsorted(time, late, side="right")
    # A piecewise linear line has its extremes at its points or at the ends of the window.
    for k in np.flatnonzero(stop > first):
        within = recorded[first[k] : stop[k]]
        upper[k], lower[k] = max(upper[k], within.max()), min(lower[k], within.min())
    return Tube(lower - value_tolerance, upper + value_tolerance)


@dataclass(frozen=True)
class Baseline:
    """A recorded run.

    Attributes
    ----------
    path: file, in the folder `baselines` beside the scenario.
    reason: why it was recorded.
    of: hashes of scenario, plant and controller, see `run_hashes`.
    metrics: name -> (linear, nonlinear), nan for what did not happen.
    signals: name -> (M,) of the nonlinear run, times [s] under "time".
    """

    path: Path
    reason: str
    of: Mapping[str, str]
    metrics: Mapping[str, tuple[float, float]]
    signals: Mapping[str, np.ndarray]

    def differences(self, result: ScenarioResult) -> tuple[str, ...]:
        """Deviations of a run from this baseline, one sentence each; empty if it is within the tolerances."""
        tolerances = result.scenario.definition.baseline
        found = [*self._metric_differences(result, tolerances.share), *self._signal_differences(result)]
        if found:
            changed = [name for name, digest in run_hashes(result).items() if self.of.get(name) != digest]
            since = f"; changed since then: {', '.join(changed)}" if changed else ""
            found.append(f"the baseline was recorded because: {self.reason}{since}")
        return tuple(found)

    def tube(self, result: ScenarioResult, signal: str) -> Tube:
        """Tube of a recorded signal at the run's times."""
        tolerances = result.scenario.definition.baseline
        return signal_tube(
            self.signals["time"],
            self.signals[signal],
            result.nonlinear.trajectory.time,
            value_tolerance=tolerances.of(signal),
            time_tolerance=tolerances.time,
        )

    def to_pandas(self, result: ScenarioResult) -> pandas.DataFrame:
        """One row per sample of the run: time and, for each signal, its value and the bounds of its tube."""
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
                    found.append(f"baseline: {name} ({word}) was {metric.format(old)} and is {metric.format(new)}")
        return found

    def _signal_differences(self, result: ScenarioResult) -> list[str]:
        run = result.nonlinear.trajectory
        found = []
        if run.time[-1] < self.signals["time"][-1] - 1.5 * float(run.time[1]):
            found.append(
                f"baseline: the run ended at {run.time[-1]:g} s, the recorded one at {self.signals['time'][-1]:g} s"
            )
        for name, (unit, shown) in SIGNALS.items():
            left = self.tube(result, name).worst_exit(run.time, run[name])
            if left is not None:
                scale = factor(shown, unit)
                found.append(
                    f"baseline: {name} leaves its tube by {left.by / scale:.3g} {shown} at {left.time:.3f} s, where it "
                    f"is {left.value / scale:.4g} {shown}"
                )
        return found


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


def run_hashes(result: ScenarioResult) -> dict[str, str]:
    """Short hashes of what determines a run: scenario (without limits and texts), plant and controller."""
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
