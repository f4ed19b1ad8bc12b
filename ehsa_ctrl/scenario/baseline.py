"""Baselines: a recorded run of a scenario, and the comparison of a new run with it.

Metrics are compared with a tolerance. Signals must stay inside a tube: the area that a rectangle covers when its centre
follows the recorded signal. The tolerances of time and value are half its width and half its height. A signal may thus
be slightly early or late as well as high or low, and a steep flank is no stricter than a flat part. Other regression
tools for simulations compare in the same way (funnel of the Lawrence Berkeley National Laboratory; csv-compare of the
Modelica Association).

Where friction makes a run unpredictable, later runs are compared up to the time at which rounding alone leaves the
tube, and their metrics within what rounding does to them, see predictability.py.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from ..core.definition import Definition, In, Metre, RadianPerSecond, Second
from ..core.unit import factor
from .metrics import METRICS

if TYPE_CHECKING:
    import pandas

    from ..simulation.trajectory import Trajectory
    from .result import ScenarioResult

#: A metric may differ by so many times the largest change by rounding in a few repetitions (engineering judgement).
SPREADS = 2.0
#: Recorded signal -> SI unit and display unit.
SIGNALS = {"x": ("m", "mm"), "omega": ("rad/s", "rpm"), "dP": ("Pa", "bar")}


class BaselineTolerances(Definition):
    """[baseline]: tolerances for the comparison with the recorded run.

    Defaults by engineering judgement: three samples of 4 ms, five standard deviations of the bench's position noise,
    10 rad/s, 2 bar and 5 %.
    """

    time: Second = Field(default=0.012, description="time shift, in either direction")
    position: Metre = Field(default=1e-4, description="half height of the position tube")
    speed: RadianPerSecond = Field(default=10.0, description="half height of the speed tube")
    pressure: Annotated[float, In("Pa")] = Field(default=2e5, description="half height of the pressure difference tube")
    share: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.05,
        description="relative change of a metric, in addition to its absolute tolerance",
    )

    @model_validator(mode="after")
    def _check_signs(self) -> BaselineTolerances:
        if min(self.time, self.position, self.speed, self.pressure) < 0:
            raise ValueError("tolerances must be at least 0")
        return self

    def of(self, signal: str) -> float:
        """Value tolerance of a recorded signal, SI unit."""
        return {"x": self.position, "omega": self.speed, "dP": self.pressure}[signal]


def recorded_of(run: Trajectory) -> tuple[str, ...]:
    """Names of SIGNALS that a run has: a carriage has a position alone."""
    states = {state.name for state in run.plant.structure.equations.states}
    return tuple(name for name in SIGNALS if {"dP": "P_1"}.get(name, name) in states)


class TubeExit(NamedTuple):
    """The sample farthest outside a tube: time [s], value, and distance beyond the bound (unit of the signal)."""

    time: float
    value: float
    distance: float


class Tube(NamedTuple):
    """Lower and upper bound (N,) of a signal at given times."""

    lower: np.ndarray
    upper: np.ndarray

    def worst_exit(self, at: np.ndarray, values: np.ndarray) -> TubeExit | None:
        """The sample of `values` (N,) at the times `at` (N,) [s] farthest outside the tube; None if all are inside."""
        distance = np.nan_to_num(np.maximum(values - self.upper, self.lower - values), nan=-np.inf)
        k = int(np.argmax(distance))
        return TubeExit(float(at[k]), float(values[k]), float(distance[k])) if distance[k] > 0.0 else None


def signal_tube(
    time: np.ndarray, recorded: np.ndarray, at: np.ndarray, *, value_tolerance: float, time_tolerance: float
) -> Tube:
    """Tube around a recorded signal, which is linear between its points; exact at the times `at` (N,) [s].

    Parameters
    ----------
    time, recorded: (M,) increasing times [s] and values; constant before the first and after the last point.
    value_tolerance, time_tolerance: half height (unit of the signal) and half width [s] of the rectangle.
    """
    early, late = at - time_tolerance, at + time_tolerance
    ends = np.interp(early, time, recorded), np.interp(late, time, recorded)
    upper, lower = np.maximum(*ends), np.minimum(*ends)
    first, stop = np.searchsorted(time, early, side="left"), np.searchsorted(time, late, side="right")
    # A piecewise linear signal has its extremes at its points or at the ends of the window.
    for k in np.flatnonzero(stop > first):
        within = recorded[first[k] : stop[k]]
        upper[k], lower[k] = max(upper[k], within.max()), min(lower[k], within.min())
    return Tube(lower - value_tolerance, upper + value_tolerance)


@dataclass(frozen=True)
class Predictability:
    """What rounding leaves of a run.

    Attributes
    ----------
    until: time [s] up to which all repetitions stay inside half the tolerances of the scenario's [baseline]; inf if
        they do so to the end.
    spread: metric -> largest change in a repetition, SI unit; inf for an event that does not happen in all of them.
        Only metrics that change by more than their absolute tolerance.
    """

    until: float = np.inf
    spread: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Baseline:
    """A recorded run.

    Attributes
    ----------
    path: file in the folder `baselines` beside the scenario.
    reason: why it was recorded.
    hashes: of scenario, plant and controller, see `run_hashes`.
    metrics: name -> (linear, nonlinear), SI units; nan for an event that did not happen.
    signals: name -> (M,) of the nonlinear run, SI units; times [s] under "time".
    predictable: what rounding leaves of the run.
    """

    path: Path
    reason: str
    hashes: Mapping[str, str]
    metrics: Mapping[str, tuple[float, float]]
    signals: Mapping[str, np.ndarray]
    predictable: Predictability = field(default_factory=Predictability)

    def differences(self, result: ScenarioResult) -> tuple[str, ...]:
        """Deviations of a run from this baseline, one sentence each; empty within the tolerances."""
        tolerances = result.scenario.definition.baseline
        found = [*self._metric_differences(result, tolerances.share), *self._signal_differences(result)]
        if found:
            changed = [name for name, digest in run_hashes(result).items() if self.hashes.get(name) != digest]
            since = f"; changed since then: {', '.join(changed)}" if changed else ""
            found.append(f"the baseline was recorded because: {self.reason}{since}")
        return tuple(found)

    def tube(self, result: ScenarioResult, signal: str) -> Tube:
        """Tube of a recorded signal at the sample times of a run; nan after the time up to which it is predictable."""
        tolerances = result.scenario.definition.baseline
        at = result.nonlinear.trajectory.time
        tube = signal_tube(
            self.signals["time"],
            self.signals[signal],
            at,
            value_tolerance=tolerances.of(signal),
            time_tolerance=tolerances.time,
        )
        return Tube(*(np.where(at <= self.predictable.until, bound, np.nan) for bound in tube))

    def to_pandas(self, result: ScenarioResult) -> pandas.DataFrame:
        """One row per sample of the run: time, and value and tube bounds of each signal, SI units."""
        import pandas

        run = result.nonlinear.trajectory
        table = {"time": run.time}
        for name in recorded_of(run):
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
                spread = SPREADS * self.predictable.spread.get(name, 0.0) if word == "nonlinear" else 0.0
                if spread < np.inf and not metric.is_close(old, new, share, spread):
                    found.append(f"baseline: {name} ({word}) was {metric.format(old)} and is now {metric.format(new)}")
        return found

    def _signal_differences(self, result: ScenarioResult) -> list[str]:
        run = result.nonlinear.trajectory
        found = []
        if run.time[-1] < self.signals["time"][-1] - 1.5 * float(run.time[1]):
            found.append(
                f"baseline: the run ended at {run.time[-1]:g} s, the recorded one at {self.signals['time'][-1]:g} s"
            )
        for name in recorded_of(run):
            if name not in self.signals:
                found.append(f"baseline: {self.path} has no {name}; record it again with --update-baselines")
                continue
            unit, display_unit = SIGNALS[name]
            exit_ = self.tube(result, name).worst_exit(run.time, run[name])
            if exit_ is not None:
                scale = factor(display_unit, unit)
                found.append(
                    f"baseline: {name} leaves its tube by {exit_.distance / scale:.3g} {display_unit} at "
                    f"{exit_.time:.3f} s, where it is {exit_.value / scale:.4g} {display_unit}"
                )
        return found


def leaves_tube(result: ScenarioResult, other: Trajectory, *, share: float) -> float:
    """Time [s] at which another run leaves the tubes around a run with this share of its tolerances; inf if never."""
    run, tolerances = result.nonlinear.trajectory, result.scenario.definition.baseline
    n = min(len(run), len(other))
    left = [run.time[n - 1]] if len(run) != len(other) else []
    for name in recorded_of(run):
        tube = signal_tube(
            run.time,
            run[name],
            other.time[:n],
            value_tolerance=share * tolerances.of(name),
            time_tolerance=share * tolerances.time,
        )
        left += list(other.time[:n][(other[name][:n] > tube.upper) | (other[name][:n] < tube.lower)][:1])
    return float(min(left, default=np.inf))


def run_hashes(result: ScenarioResult) -> dict[str, str]:
    """Short hashes of the inputs that determine a run: scenario (without limits and texts), plant and controller."""
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
