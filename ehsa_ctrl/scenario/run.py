"""The main job: design on the identified linear model, check on the nonlinear plant, compare, judge."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.catalogue import scenarios
from ..core.definition import read_definition
from ..core.errors import InputError, SimulationError
from ..core.protocol import MEASURED, Controller
from ..core.unit import factor
from ..design.analysis import LoopAnalysis, analyse_loop
from ..design.load import load_controller
from ..plant.linear import three_state
from ..plant.plant import Plant, load_plant
from ..simulation.closed_loop import ClosedLoop, run_closed_loop
from ..simulation.limits import Exceedance
from ..simulation.sensors import Sensors
from ..simulation.trajectory import versions
from .definition import Measuring, ScenarioFile
from .metrics import METRICS, loop_metrics

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Scenario:
    """A scenario's definition with its name and file."""

    name: str
    definition: ScenarioFile
    path: Path | None = None

    @property
    def title(self) -> str:
        return self.definition.title


def load_scenario(name: str | Path) -> Scenario:
    """Load a scenario by catalogue name or path. Raises InputError with file and key."""
    path = scenarios.find(name)
    return Scenario(path.stem, read_definition(path, ScenarioFile), path)


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

    @property
    def expected_trips(self) -> tuple[str, ...]:
        return tuple(self.scenario.definition.expect_trips)

    @property
    def failures(self) -> tuple[str, ...]:
        """Why the scenario failed, in sentences; empty if it passed."""
        reasons = [str(judgement) for judgement in self.judgements if not judgement.passed]
        tripped = {trip.limit for trip in self.trips}
        if self.nonlinear.trajectory.stopped and not tripped & set(self.expected_trips):
            reasons.append(self.nonlinear.trajectory.stopped)
        reasons += [f"trip: {trip}" for trip in self.trips if trip.limit not in self.expected_trips]
        reasons += [f"expected trip {name} did not happen" for name in self.expected_trips if name not in tripped]
        return tuple(reasons)

    @property
    def passed(self) -> bool:
        return not self.failures

    @property
    def plant(self) -> Plant:
        return self.nonlinear.trajectory.plant

    def to_dict(self) -> dict[str, Any]:
        """Plain values for results.json, SI units."""
        return {
            "scenario": self.scenario.name,
            "title": self.scenario.title,
            "why": self.scenario.definition.why,
            "controller": self.controller.name,
            "passed": self.passed,
            "failures": list(self.failures),
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
                name: {"linear": linear, "nonlinear": nonlinear, "unit": METRICS[name].unit}
                for name, (linear, nonlinear) in self.metrics.items()
            },
            "margins": self.loop.to_dict() if self.loop else None,
            "linear_model_passed_limits": [str(item) for item in self.linear.trajectory.exceeded],
            "assumed": {p.name: p.value for p in self.plant.parameters.values() if p.source == "assumed"},
            "seed": self.scenario.definition.sensors.seed,
            "seconds": self.seconds,
            "provenance": versions(),
        }

    def to_pandas(self) -> pandas.DataFrame:
        """One row a metric: linear prediction, nonlinear outcome, in the units a person reads."""
        import pandas

        rows = []
        for name, pair in self.metrics.items():
            metric = METRICS[name]
            scale = factor(metric.shown, metric.unit)
            rows.append((name, metric.shown, pair[0] / scale, pair[1] / scale))
        return pandas.DataFrame(rows, columns=["metric", "unit", "linear", "nonlinear"]).set_index("metric")

    def plot(self) -> Figure:
        """Reference, position, speed, pressures and current, linear and nonlinear."""
        from ..report.figures import scenario_figure

        return scenario_figure(self)

    def __str__(self) -> str:
        verdict = "passed" if self.passed else "FAILED: " + "; ".join(self.failures)
        table = self.to_pandas().to_string(float_format=lambda value: f"{value:.4g}")
        return f"{self.scenario.name} with {self.controller.name}: {verdict}\n{table}"

    __repr__ = __str__

    def _repr_html_(self) -> str:
        import html

        return f"<p>{html.escape(str(self).splitlines()[0])}</p>" + str(self.to_pandas().to_html(float_format="%.4g"))


def run(
    scenario: str | Path | Scenario,
    *,
    controller: str | Path | None = None,
    plant: str | Path | None = None,
    design: str | Path | None = None,
) -> ScenarioResult:
    """Run a scenario: design the controller, predict with the linear model, check on the nonlinear plant.

    The controller is designed on the plant's identified linear set as the plant's file has it; the scenario's load
    and disturbances act in both runs.

    Parameters
    ----------
    scenario: a name, a path, or a loaded scenario.
    controller, plant: instead of those that the scenario names.
    design: the plant whose linear set the controller is designed on and the prediction is made with, if that is
        another one than the plant it is checked on: the rig's identified model on the plant that one takes for true.

    Raises
    ------
    InputError: a definition is wrong or refers to something that is not there.
    SimulationError: a run could not be finished though no limit of the plant was passed.
    """
    begun = clock.perf_counter()
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    definition = loaded.definition
    where = loaded.path or loaded.name
    checked = plant or definition.plant
    designed = design or checked
    try:
        design_model = three_state(load_plant(designed, model="linear"))
        linear = load_plant(designed, model="linear", settings=_known_to_linear(definition, designed))
        nonlinear = load_plant(checked, model="nonlinear", settings=definition.all_settings)
        chosen = load_controller(controller or definition.controller, design_model)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    dt = chosen.sample_time
    time = dt * np.arange(int(round(definition.duration / dt)) + 1)
    reference = definition.reference.signal(time)
    force = np.zeros(time.size)
    for step in definition.disturbance:
        force[(time >= step.start - 1e-9) & (time < step.start + step.duration - 1e-9)] += step.force
    runs = []
    for believed in (linear, nonlinear):
        sensors = _sensors(believed, definition.sensors)
        loop = run_closed_loop(
            believed,
            chosen,
            reference,
            force=force,
            sensors=sensors,
            lag=definition.sensors.lag,
            raise_on_failure=False,
        )
        if loop.trajectory.stopped and not loop.trajectory.exceeded:
            raise SimulationError(loop.trajectory.stopped)
        runs.append(loop)
    runs = [loop.first(min(len(other.trajectory) for other in runs)) for loop in runs]
    holds = definition.reference.holds()
    holds += [edge for step in definition.disturbance for edge in (step.start, step.start + step.duration)]
    limit = float(getattr(chosen, "current_limit", np.inf))
    numbers = [
        loop_metrics(
            loop,
            jumps=[at for at in definition.reference.jumps() if at < definition.duration],
            holds=[at for at in holds if at < definition.duration],
            current_limit=limit,
        )
        for loop in runs
    ]
    metrics = {name: (numbers[0][name], numbers[1][name]) for name in METRICS}
    return ScenarioResult(
        scenario=loaded,
        controller=chosen,
        linear=runs[0],
        nonlinear=runs[1],
        metrics=metrics,
        judgements=tuple(
            Judgement(name, metrics[name][1], bound.min, bound.max) for name, bound in definition.limits.items()
        ),
        trips=runs[1].trajectory.exceeded,
        loop=analyse_loop(design_model, chosen) if hasattr(chosen, "feedback") else None,
        seconds=clock.perf_counter() - begun,
    )


def _sensors(plant: Plant, measuring: Measuring) -> Sensors:
    """The plant's sensors with what the scenario changes; without noise means without any."""
    changed = {channel: replace(plant.sensors[channel], **measuring.changes(channel)) for channel in MEASURED}
    return Sensors.of(replace(plant, sensors={**plant.sensors, **changed}), seed=measuring.seed, noise=measuring.noise)


def _known_to_linear(definition: ScenarioFile, name: str | Path) -> dict[str, str]:
    """The settings that the linear set has as well: a scenario may change A_FR, which only the nonlinear one knows."""
    plant = load_plant(name, model="linear")
    return {
        key: value
        for key, value in definition.all_settings.items()
        if key.startswith("load.") or key in plant.parameters
    }
