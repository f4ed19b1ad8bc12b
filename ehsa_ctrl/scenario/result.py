"""The result of a scenario, its limits and its verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.controller_interface import MEASURED, Controller
from ..core.log import REFERENCES
from ..core.parameter import Parameter
from ..core.plotting import draw
from ..core.result import Result, as_dict
from ..design.analysis.loop import LoopAnalysis
from ..plant.file import label
from ..plant.plant import Plant
from ..simulation.closed_loop import ClosedLoop
from ..simulation.limits import Exceedance
from ..simulation.trajectory import Trajectory, versions
from .baseline import Baseline
from .definition import Scenario
from .metrics import METRICS
from .outcome import Outcome

if TYPE_CHECKING:
    from pathlib import Path

    import pandas
    from matplotlib.figure import Figure

    from .sensitivity import AssumptionSensitivity

Verdict = Literal["pass", "fail", "untested"]


@dataclass(frozen=True)
class LimitCheck:
    """One limit of a scenario and the metric's value on the nonlinear plant."""

    metric: str
    value: float
    lower: float | None
    upper: float | None

    @property
    def passed(self) -> bool:
        """Whether the limit holds; nan, such as the settling time of a step that never settles, fails every limit."""
        above = self.lower is None or self.value >= self.lower
        below = self.upper is None or self.value <= self.upper
        return bool(np.isfinite(self.value) and above and below)

    @property
    def margin(self) -> float:
        """Distance to the nearer bound relative to that bound; negative if violated, -inf for nan."""
        if not np.isfinite(self.value):
            return float("-inf")
        signed = ((-1, self.lower), (1, self.upper))
        # 1e-3 of the SI unit replaces a bound of zero.
        return float(min(sign * (b - self.value) / (abs(b) or 1e-3) for sign, b in signed if b is not None))

    def __str__(self) -> str:
        metric = METRICS[self.metric]
        value = metric.format(self.value) if np.isfinite(self.value) else "did not happen"
        return f"{self.metric} {value} ({metric.format_bounds(self.lower, self.upper)})"


#: Reasons that a one-line summary lists before it counts the others.
LISTED_REASONS = 3


def first_reasons(reasons: Sequence[str]) -> str:
    """The first reasons as one sentence, with the number of the others."""
    left = len(reasons) - LISTED_REASONS
    return "; ".join(reasons) if left <= 1 else "; ".join([*reasons[:LISTED_REASONS], f"and {left} more"])


def failures_of(checks: Sequence[LimitCheck], run: Trajectory, expected_trips: Sequence[str]) -> tuple[str, ...]:
    """Failures as sentences: violated limits, unexpected trips, and expected trips that did not happen."""
    reasons = [str(check) for check in checks if not check.passed]
    tripped = {trip.limit for trip in run.exceeded}
    if run.stopped and not tripped & set(expected_trips):
        reasons.append(run.stopped)
    reasons += [f"trip: {trip}" for trip in run.exceeded if trip.limit not in expected_trips]
    reasons += [f"expected trip {name} did not happen" for name in expected_trips if name not in tripped]
    return tuple(reasons)


@dataclass(frozen=True, repr=False)
class ScenarioResult(Result):
    """The result of a scenario.

    Attributes
    ----------
    scenario, controller: what was run.
    linear: prediction with the linear model. nonlinear: run on the nonlinear plant.
    metrics: name -> (linear, nonlinear), SI units.
    limit_checks: the scenario's limits on the nonlinear plant.
    trips: plant limits that the nonlinear run exceeded.
    loop: margins on the design model; None for a controller without linear feedback.
    seconds: wall time.
    baseline: recorded run for comparison; None if none exists or if another plant was simulated.
    sensitivities: of the verdict to each assumed parameter; None if not requested.
    files: input files of scenario, controller and plants.
    settings: plant parameters set for this run.
    draw: run of a Monte Carlo campaign that this one repeats; None for any other.
    """

    scenario: Scenario
    controller: Controller
    linear: ClosedLoop
    nonlinear: ClosedLoop
    metrics: Mapping[str, tuple[float, float]]
    limit_checks: tuple[LimitCheck, ...]
    trips: tuple[Exceedance, ...]
    loop: LoopAnalysis | None
    seconds: float
    baseline: Baseline | None = None
    sensitivities: tuple[AssumptionSensitivity, ...] | None = None
    files: tuple[Path, ...] = ()
    settings: Mapping[str, str | float] = field(default_factory=dict)
    draw: Outcome | None = None

    @property
    def expected_trips(self) -> tuple[str, ...]:
        return tuple(self.scenario.definition.expect_trips)

    @property
    def limit_failures(self) -> tuple[str, ...]:
        """Failures as sentences, without differences from the baseline; empty if all limits hold."""
        return failures_of(self.limit_checks, self.nonlinear.trajectory, self.expected_trips)

    @cached_property
    def failures(self) -> tuple[str, ...]:
        """All failures as sentences; empty if the scenario passed."""
        return (*self.limit_failures, *(self.baseline.differences(self) if self.baseline else ()))

    @property
    def passed(self) -> bool:
        """Whether there is no failure; also true for a scenario without any test, see `verdict`."""
        return not self.failures

    @property
    def verdict(self) -> Verdict:
        """The verdict; "untested" for a scenario without limit, expected trip or baseline."""
        if not self.passed:
            return "fail"
        return "pass" if self.limit_checks or self.expected_trips or self.baseline else "untested"

    @property
    def current_limit_reached(self) -> bool:
        """Whether the commanded current reached the controller's limit."""
        limit = float(getattr(self.controller, "current_limit", np.inf))
        return bool((abs(self.nonlinear.asked) >= limit * (1 - 1e-9)).any())

    @property
    def solver_words(self) -> str:
        """Solver of an MPC and its samples of the nonlinear run without a solution; empty for any other controller."""
        solver = getattr(getattr(self.controller, "law", None), "solver", "")
        if not solver or "solver_reason" not in self.nonlinear.traces:
            return ""
        reasons = self.nonlinear["solver_reason"]
        return f"solver {solver}: {np.count_nonzero(reasons)} of {reasons.size} samples without a solution"

    @property
    def plant(self) -> Plant:
        return self.nonlinear.trajectory.plant

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of the nonlinear run, see `Trajectory.warnings`."""
        return self.nonlinear.trajectory.warnings

    @property
    def _plant_numbers(self) -> tuple[Parameter, ...]:
        """All numbers of the plant's file: parameters and sensor data."""
        sensors = [number for sensor in self.plant.sensors.values() for number in sensor.stated]
        return (*self.plant.parameters.values(), *sensors)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for results.json, SI units."""
        scenario, plant, metrics = self.scenario, self.plant, self.metrics
        return as_dict(
            self, "current_limit_reached solver_words settings passed verdict failures expected_trips seconds",
            scenario=scenario.name, title=scenario.title, why=scenario.definition.why,
            definition=scenario.definition.model_dump(by_alias=True), plant=plant.name, plant_title=plant.title,
            controller=self.controller.name, sample_time=self.controller.sample_time,
            controller_words=str(self.controller) if "__str__" in vars(type(self.controller)) else "",
            tolerance=self.nonlinear.trajectory.tolerance, margins=self.loop, assumed_ranges=self.sensitivities,
            draw=self.draw and as_dict(self.draw, "run seed parameters"),
            baseline=self.baseline and {"file": str(self.baseline.path), "reason": self.baseline.reason},
            limits=[as_dict(j, "metric value passed", min=j.lower, max=j.upper) for j in self.limit_checks],
            trips=[as_dict(trip, sentence=str(trip)) for trip in self.trips], **self.nonlinear.trajectory.shown(),
            metrics={
                name: {"linear": pair[0], "nonlinear": pair[1], "gap": gap(*pair), "unit": METRICS[name].unit}
                for name, pair in metrics.items()
            },
            not_defined={name: why for name in METRICS if (why := scenario.definition.reason_undefined(name))},
            linear_model_passed_limits=[str(item) for item in self.linear.trajectory.exceeded],
            assumed={p.name: p.value for p in self._plant_numbers if p.source == "assumed"},
            warnings=self.warnings, seed=scenario.definition.sensors.seed, provenance=versions(),
        )  # fmt: skip

    def to_pandas(self) -> pandas.DataFrame:
        """One row per metric: linear prediction, nonlinear outcome and their difference, in display units."""
        import pandas

        rows = {
            name: (METRICS[name].display_unit, *(value / METRICS[name].scale for value in (*pair, gap(*pair))))
            for name, pair in self.metrics.items()
        }
        columns = ["unit", "linear", "nonlinear", "gap"]
        return pandas.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("metric")

    def cell(self, metric: str, value: float) -> str:
        """A value [SI unit] as text in the metric's display unit; "-" for nan."""
        if self.scenario.definition.reason_undefined(metric):
            return "not defined"
        return "-" if np.isnan(value) else f"{value / METRICS[metric].scale:.4g}"

    def table(self) -> pandas.DataFrame:
        """The table of `to_pandas` with formatted cells."""
        frame = self.to_pandas()
        cells = [[self.cell(name, value) for value in (*pair, gap(*pair))] for name, pair in self.metrics.items()]
        frame[["linear", "nonlinear", "gap"]] = cells
        return frame

    def time_series(self) -> pandas.DataFrame:
        """One row per sample of the nonlinear run, SI units. Saved as CSV it is a log that every command reads.

        Columns: t, current (or another drive) and the sensor readings, named as in a log (nan for a lost reading);
        reference, the target position, with its velocity and acceleration, reference_force where there is a force
        target; then the true signals of both models with the suffixes _linear and _nonlinear.
        """
        import pandas

        run = self.nonlinear
        columns = {"t": run.trajectory.time, run.trajectory.plant.structure.system.drive: run.trajectory.current}
        columns |= dict(zip(MEASURED, run.measured.T, strict=True))
        columns |= dict(zip(REFERENCES, run.reference.T, strict=True))
        if run.force_reference is not None:
            columns["reference_force"] = run.force_reference
        table = pandas.DataFrame(columns).dropna(axis="columns", how="all")
        for word, loop in (("linear", self.linear), ("nonlinear", run)):
            table = table.join(loop.trajectory.to_pandas().drop(columns="time").add_suffix(f"_{word}"))
        return table

    def plot(self) -> Figure:
        """Figure: reference, position, error, speed, pressures and current of both runs."""
        return draw(self)

    def plot_baseline(self) -> Figure:
        """Figure: this run and the tubes around the recorded signals. Raises InputError without a baseline."""
        return draw(self, view="baseline")

    def __str__(self) -> str:
        verdict = "passed" if self.passed else "FAILED: " + first_reasons(self.failures)
        lines = [f"{self.scenario.name} with {self.controller.name}{self.of_draw}: {verdict}", self.table().to_string()]
        lines += map(str, self.nonlinear.trajectory.extrapolated)
        return "\n".join([*lines, *([self.solver_words] if self.solver_words else [])])

    @property
    def of_draw(self) -> str:
        """Which run of a campaign this is, for titles and lists; empty for any other run."""
        if self.draw is None:
            return ""
        drawn = ", ".join(f"{label(name)} = {value:.5g}" for name, value in self.draw.parameters.items())
        return f", run {self.draw.run} of a campaign ({drawn or 'no parameter drawn'}; sensor noise {self.draw.seed})"

    def _repr_html_(self) -> str:
        import html

        return f"<p>{html.escape(str(self).splitlines()[0])}</p>" + str(self.table().to_html())


def gap(linear: float, nonlinear: float) -> float:
    """Nonlinear outcome minus linear prediction; nan if either is not finite."""
    return nonlinear - linear if np.isfinite(linear) and np.isfinite(nonlinear) else float("nan")
