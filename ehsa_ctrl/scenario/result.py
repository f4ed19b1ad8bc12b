"""What a scenario gave, and whether that is what it should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.controller_interface import MEASURED, Controller
from ..core.parameter import Parameter
from ..core.plotting import draw
from ..core.unit import factor
from ..design.analysis.loop import LoopAnalysis
from ..plant.plant import Plant
from ..simulation.closed_loop import ClosedLoop
from ..simulation.limits import Exceedance
from ..simulation.trajectory import Trajectory, versions
from .baseline import Baseline
from .metrics import METRICS
from .scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path

    import pandas
    from matplotlib.figure import Figure

    from .assumed import Swing

Verdict = Literal["pass", "fail", "untested"]


@dataclass(frozen=True)
class Judgement:
    """One limit of a scenario and whether the nonlinear plant kept it."""

    metric: str
    value: float
    lower: float | None
    upper: float | None

    @property
    def passed(self) -> bool:
        """A metric that is nan (never settled, say) keeps no limit."""
        above = self.lower is None or self.value >= self.lower
        below = self.upper is None or self.value <= self.upper
        return bool(np.isfinite(self.value) and above and below)

    @property
    def margin(self) -> float:
        """Room that is left, as a share of the bound (of a thousandth of the metric's unit for a bound of zero);
        negative beyond it, -inf for what did not happen."""
        if not np.isfinite(self.value):
            return float("-inf")
        rooms = [
            (sign * (bound - self.value)) / (abs(bound) or 1e-3)
            for sign, bound in ((-1, self.lower), (1, self.upper))
            if bound is not None
        ]
        return float(min(rooms))

    def __str__(self) -> str:
        metric = METRICS[self.metric]
        scale = factor(metric.shown, metric.unit)
        unit = "" if metric.shown == "1" else f" {metric.shown}"
        bounds = [
            f"{word} {bound / scale:g}{unit}"
            for word, bound in (("at least", self.lower), ("at most", self.upper))
            if bound is not None
        ]
        value = f"{self.value / scale:.4g}{unit}" if np.isfinite(self.value) else "did not happen"
        return f"{self.metric} {value} ({' and '.join(bounds)})"


#: Reasons that a sentence names; of more it says how many.
NAMED = 3


def few(reasons: Sequence[str]) -> str:
    """Reasons in a sentence: the first ones, and how many more there are."""
    left = len(reasons) - NAMED
    return "; ".join(reasons) if left <= 1 else "; ".join([*reasons[:NAMED], f"and {left} more"])


def failures_of(judgements: Sequence[Judgement], run: Trajectory, expected_trips: Sequence[str]) -> tuple[str, ...]:
    """Limits of the scenario that were not kept, limits of the plant passed unexpectedly, and expected ones that were
    not passed, in sentences."""
    reasons = [str(judgement) for judgement in judgements if not judgement.passed]
    tripped = {trip.limit for trip in run.exceeded}
    if run.stopped and not tripped & set(expected_trips):
        reasons.append(run.stopped)
    reasons += [f"trip: {trip}" for trip in run.exceeded if trip.limit not in expected_trips]
    reasons += [f"expected trip {name} did not happen" for name in expected_trips if name not in tripped]
    return tuple(reasons)


@dataclass(frozen=True)
class ScenarioResult:
    """What a scenario gave.

    Attributes
    ----------
    scenario, controller: what was run.
    linear: prediction, the controller on the identified linear model. nonlinear: the check.
    metrics: name -> (linear, nonlinear).
    judgements: the scenario's limits, on the nonlinear plant.
    trips: limits of the plant that the nonlinear run passed; expected: those that the scenario asserts.
    loop: margins on the design model, None for a controller without linear feedback.
    seconds: wall time.
    baseline: the recorded run that it is held against; None where there is none, or where another plant was checked.
    swings: the scenario over the believed range of each assumed parameter; None where that was not asked for.
    files: scenario, controller and plants, as far as they were read from files.
    settings: what was set of the plant for this run alone.
    """

    scenario: Scenario
    controller: Controller
    linear: ClosedLoop
    nonlinear: ClosedLoop
    metrics: Mapping[str, tuple[float, float]]
    judgements: tuple[Judgement, ...]
    trips: tuple[Exceedance, ...]
    loop: LoopAnalysis | None
    seconds: float
    baseline: Baseline | None = None
    swings: tuple[Swing, ...] | None = None
    files: tuple[Path, ...] = ()
    settings: Mapping[str, str | float] = field(default_factory=dict)

    @property
    def expected_trips(self) -> tuple[str, ...]:
        return tuple(self.scenario.definition.expect_trips)

    @property
    def other_failures(self) -> tuple[str, ...]:
        """Why the scenario failed, in sentences, baseline apart; empty if it kept its limits."""
        return failures_of(self.judgements, self.nonlinear.trajectory, self.expected_trips)

    @cached_property
    def failures(self) -> tuple[str, ...]:
        """Why the scenario failed, in sentences; empty if it passed."""
        return (*self.other_failures, *(self.baseline.differences(self) if self.baseline else ()))

    @property
    def passed(self) -> bool:
        """Nothing failed; a scenario that tests nothing is among these, see `verdict`."""
        return not self.failures

    @property
    def verdict(self) -> Verdict:
        """ "untested" for a run that nothing was asked of: no limit, no expected trip, no baseline."""
        if not self.passed:
            return "fail"
        asked = self.judgements or self.expected_trips or self.baseline
        return "pass" if asked else "untested"

    @property
    def plant(self) -> Plant:
        return self.nonlinear.trajectory.plant

    @property
    def _numbers(self) -> tuple[Parameter, ...]:
        """What the plant's file states: parameters, and the sensors' noise."""
        sensors = [number for sensor in self.plant.sensors.values() for number in sensor.stated]
        return (*self.plant.parameters.values(), *sensors)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for results.json, SI units."""
        return {
            "scenario": self.scenario.name,
            "title": self.scenario.title,
            "why": self.scenario.definition.why,
            "controller": self.controller.name,
            "settings": dict(self.settings),
            "passed": self.passed,
            "verdict": self.verdict,
            "failures": list(self.failures),
            "baseline": self.baseline and {"file": str(self.baseline.path), "reason": self.baseline.reason},
            "limits": [
                {"metric": j.metric, "value": j.value, "min": j.lower, "max": j.upper, "passed": j.passed}
                for j in self.judgements
            ],
            "trips": [
                {"limit": t.limit, "allowed": t.allowed, "reached": t.reached, "unit": t.unit, "first": t.first}
                for t in self.trips
            ],
            "expected_trips": list(self.expected_trips),
            "metrics": {
                name: {
                    "linear": linear,
                    "nonlinear": nonlinear,
                    "gap": gap(linear, nonlinear),
                    "unit": METRICS[name].unit,
                }
                for name, (linear, nonlinear) in self.metrics.items()
            },
            "not_defined": {name: why for name in METRICS if (why := self.scenario.definition.undefined(name))},
            "margins": self.loop.to_dict() if self.loop else None,
            "linear_model_passed_limits": [str(item) for item in self.linear.trajectory.exceeded],
            "assumed": {p.name: p.value for p in self._numbers if p.source == "assumed"},
            "assumed_ranges": None if self.swings is None else [swing.to_dict() for swing in self.swings],
            "warnings": list(self.plant.implausible),
            "seed": self.scenario.definition.sensors.seed,
            "seconds": self.seconds,
            "provenance": versions(),
        }

    def to_pandas(self) -> pandas.DataFrame:
        """One row a metric: linear prediction, nonlinear outcome and their gap, in the units a person reads."""
        import pandas

        rows = []
        for name, pair in self.metrics.items():
            metric = METRICS[name]
            scale = factor(metric.shown, metric.unit)
            rows.append((name, metric.shown, pair[0] / scale, pair[1] / scale, gap(*pair) / scale))
        return pandas.DataFrame(rows, columns=["metric", "unit", "linear", "nonlinear", "gap"]).set_index("metric")

    def cell(self, metric: str, value: float) -> str:
        """A value of this run [SI unit] as a table has it, in the metric's shown unit; "-" for what did not happen."""
        if self.scenario.definition.undefined(metric):
            return "not defined"
        return "-" if np.isnan(value) else f"{value / factor(METRICS[metric].shown, METRICS[metric].unit):.4g}"

    def table(self) -> pandas.DataFrame:
        """As to_pandas, in words."""
        frame = self.to_pandas()
        cells = [[self.cell(name, value) for value in (*pair, gap(*pair))] for name, pair in self.metrics.items()]
        frame[["linear", "nonlinear", "gap"]] = cells
        return frame

    def time_series(self) -> pandas.DataFrame:
        """One row a sample of the run on the nonlinear plant, SI units; as CSV it is a log that every command reads.

        Columns: t, current and what the sensors gave, named as in a log (nan where a reading was lost); reference, the
        position asked for; then the true signals of both models, with _linear and _nonlinear behind their names.
        """
        import pandas

        run = self.nonlinear
        columns = {"t": run.trajectory.time, "current": run.trajectory["current"]}
        columns |= dict(zip(MEASURED, run.measured.T, strict=True)) | {"reference": run.reference[:, 0]}
        table = pandas.DataFrame(columns).dropna(axis="columns", how="all")
        for word, loop in (("linear", self.linear), ("nonlinear", run)):
            table = table.join(loop.trajectory.to_pandas().drop(columns="time").add_suffix(f"_{word}"))
        return table

    def plot(self) -> Figure:
        """Reference, position, speed, pressures and current, linear and nonlinear."""
        return draw(self)

    def plot_baseline(self) -> Figure:
        """The recorded signals with their tubes, and this run. Raises InputError for a run without a baseline."""
        return draw(self, view="baseline")

    def __str__(self) -> str:
        verdict = "passed" if self.passed else "FAILED: " + few(self.failures)
        return f"{self.scenario.name} with {self.controller.name}: {verdict}\n{self.table().to_string()}"

    __repr__ = __str__

    def _repr_html_(self) -> str:
        import html

        return f"<p>{html.escape(str(self).splitlines()[0])}</p>" + str(self.table().to_html())


def gap(linear: float, nonlinear: float) -> float:
    """What the plant did beyond the prediction; nan where one of them did not happen."""
    return nonlinear - linear if np.isfinite(linear) and np.isfinite(nonlinear) else float("nan")
