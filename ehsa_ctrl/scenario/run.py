"""The main job: design on the identified linear model, check on the nonlinear plant, compare, judge."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.catalogue import controllers, plants
from ..core.controller_interface import MEASURED, Controller
from ..core.errors import InputError
from ..design.analysis.loop import analyse_loop
from ..design.controller import SampledController
from ..design.load import load_controller, read_controller
from ..plant.file import key_of, symbol_of
from ..plant.linear import three_state
from ..plant.plant import Model, Plant, knows, load_plant, with_settings
from ..simulation.closed_loop import ClosedLoop, run_closed_loop
from ..simulation.sensors import Sensors
from .assumed import over_assumed
from .baseline import baseline_path, read_baseline
from .definition import Measuring, ScenarioFile
from .fault import faults_of
from .metrics import METRICS, loop_metrics
from .ratings import require_within
from .result import Judgement, ScenarioResult
from .scenario import Scenario, load_scenario

if TYPE_CHECKING:
    import control


#: Most samples of a scenario: more than an hour at 250 Hz. Beyond it a time unit is wrong.
MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class Case:
    """A scenario with everything it refers to: designed, but not run yet.

    Attributes
    ----------
    scenario, controller: what will be run.
    model: linear model on which the controller was designed.
    linear, nonlinear: plants as they are believed in this scenario, for the prediction and the check.
    files: where all this was read from. settings: what was set for one run, on top of the scenario's own.
    """

    scenario: Scenario
    controller: Controller
    model: control.StateSpace
    linear: Plant
    nonlinear: Plant
    files: tuple[Path, ...] = ()
    settings: Mapping[str, str | float] = field(default_factory=dict)

    def loop(self, plant: Plant, seed: int | None = None) -> ClosedLoop:
        """Run the scenario on a plant, with the scenario's own seed of the sensors' noise or another one.

        Raises SimulationError for a run that could not be finished though no limit of the plant was passed.
        """
        definition = self.scenario.definition
        dt = self.controller.sample_time
        time = dt * np.arange(int(round(definition.duration / dt)) + 1)
        force = np.zeros(time.size)
        for step in definition.disturbance:
            force[(time >= step.start - 1e-9) & (time < step.start + step.duration - 1e-9)] += step.force
        measuring = definition.sensors if seed is None else definition.sensors.model_copy(update={"seed": seed})
        loop = run_closed_loop(
            plant,
            self.controller,
            definition.reference.signal(time),
            force=force,
            sensors=_sensors(plant, measuring),
            lag=definition.sensors.lag,
            faults=faults_of(definition.fault),
            raise_on_failure=False,
        )
        loop.trajectory.explained()
        return loop

    def metrics(self, loop: ClosedLoop, wanted: tuple[str, ...] | None = None) -> dict[str, float]:
        """All of METRICS for a run of this case; with `wanted`, what takes its time only if it is among these."""
        definition = self.scenario.definition
        return loop_metrics(
            loop,
            jumps=[at for at in definition.reference.jumps() if at < definition.duration],
            holds=definition.holds(),
            current_limit=float(getattr(self.controller, "current_limit", np.inf)),
            first_fault=definition.first_fault,
            lag=definition.sensors.lag,
            shortest=wanted is None or bool({"ShortestTime", "SettlingRatio"} & {*wanted}),
        )

    def judge(self, metrics: dict[str, float]) -> tuple[Judgement, ...]:
        """The scenario's limits on these metrics."""
        limits = self.scenario.definition.limits
        return tuple(Judgement(name, metrics[name], bound.min, bound.max) for name, bound in limits.items())


def prepare(
    scenario: str | Path | Scenario,
    *,
    controller: str | Path | Controller | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
) -> Case:
    """Load a scenario and what it refers to and design its controller; arguments and errors as in `run`."""
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    definition, beside = loaded.definition, loaded.path
    where = loaded.path or loaded.name
    try:
        checked = _plant_file(plant) or plants.find(definition.plant, beside=beside)
        designed = _plant_file(design) or checked
        law: Path | Controller
        if controller is None or isinstance(controller, str | Path):
            law = controllers.find(controller) if controller else controllers.find(definition.controller, beside=beside)
        elif isinstance(controller, Controller):
            law = controller
        else:
            raise InputError(
                f"controller is a {type(controller).__name__}; expected a name, a path, or a controller as "
                "load_controller gives it"
            )
        base = _of_model("design", design, "linear") or load_plant(designed, model="linear")
        model = three_state(base)
        linear = with_settings(base, _known_to_linear(definition, base))
        nominal = _of_model("plant", plant, "nonlinear") or load_plant(checked, model="nonlinear")
        nonlinear = with_settings(nominal, definition.all_settings)
        if isinstance(law, Path):
            require_within(law, read_controller(law, base.sample_time)[1], nominal)
        chosen: Controller = load_controller(law, model, sample_time=base.sample_time) if isinstance(law, Path) else law
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    samples = definition.duration / chosen.sample_time
    if samples > MOST_SAMPLES:
        raise InputError(
            f"{where}: duration = {definition.duration:g} s is {samples:.3g} samples of {chosen.name}, whose "
            f"sample_time is {chosen.sample_time:g} s; expected at most {MOST_SAMPLES}"
        )
    if definition.sensors.lag >= samples:
        raise InputError(
            f"{where}: [sensors] lag = {definition.sensors.lag} samples is as long as the run, of {samples:.4g}; "
            "give a longer duration or a shorter lag"
        )
    if definition.supervision is not None and isinstance(chosen, SampledController):
        chosen = replace(chosen, supervision=definition.supervision.of(linear))
    given = dict(settings or {})
    # The load is the scenario's and acts in both runs; the rest is what the plant checked on is believed to be.
    nonlinear = with_settings(nonlinear, given)
    linear = with_settings(linear, {key: value for key, value in given.items() if _is_load(key)})
    files = [loaded.path, law if isinstance(law, Path) else None, checked, designed]
    known = tuple(dict.fromkeys(Path(file) for file in files if file is not None))
    return Case(loaded, chosen, model, linear, nonlinear, known, given)


def run(
    scenario: str | Path | Scenario,
    *,
    controller: str | Path | Controller | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
) -> ScenarioResult:
    """Run a scenario: linear prediction, nonlinear check, comparison, judgement.

    The controller is designed on the plant's identified linear set as the plant's file has it; the scenario's load,
    disturbances and faults act in both runs.

    Parameters
    ----------
    scenario: a name, a path, or a loaded scenario. What it refers to is looked for beside its own file first.
    controller, plant: instead of those that the scenario names. A controller that is designed already, from
        `load_controller` or a user's own, is run as it is and held against no baseline.
        A plant that was loaded, changed or identified is taken as it is, with the scenario's load and settings on top;
        the linear set of its file is the one to design on.
    design: the plant whose linear set the controller is designed on and the prediction is made with, if that is
        another one than the plant it is checked on: the rig's identified model on the plant that one takes for true.
    assumed: also run it with each assumed parameter at both ends of its believed range; None: if that is quick, which
        it is with a compiled controller.
    settings: what the plant that is checked on is believed to be in this run, as for `load_plant`, on top of the
        scenario's own: {"K_T": 1.1, "load.stiffness": "50 N/mm"}. The load acts in the prediction too; the controller
        and the rest of the prediction stay with the linear set. There is no recorded run of such a plant.

    Raises
    ------
    InputError: a definition is wrong or refers to something that is not there.
    SimulationError: a run could not be finished though no limit of the plant was passed.
    """
    begun = clock.perf_counter()
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    loops = [case.loop(model) for model in (case.linear, case.nonlinear)]
    loops = [loop.first(min(len(other.trajectory) for other in loops)) for loop in loops]
    predicted, outcome = (case.metrics(loop) for loop in loops)
    result = ScenarioResult(
        scenario=case.scenario,
        controller=case.controller,
        linear=loops[0],
        nonlinear=loops[1],
        metrics={name: (predicted[name], outcome[name]) for name in METRICS},
        judgements=case.judge(outcome),
        trips=loops[1].trajectory.exceeded,
        loop=analyse_loop(case.model, case.controller) if isinstance(case.controller, SampledController) else None,
        seconds=clock.perf_counter() - begun,
        files=case.files,
        settings=case.settings,
    )
    if assumed or (assumed is None and case.controller.compiled is not None):
        result = replace(result, swings=over_assumed(case, kept=not result.other_failures))
    # Another plant than the scenario's, or a controller that no file describes, has no recorded run.
    recorded = not plant and not design and not settings and (controller is None or isinstance(controller, str | Path))
    path = baseline_path(result) if recorded else None
    return replace(result, baseline=read_baseline(path) if path and path.is_file() else None)


def _sensors(plant: Plant, measuring: Measuring) -> Sensors:
    """The plant's sensors with what the scenario changes; without noise means without any."""
    changed = {channel: replace(plant.sensors[channel], **measuring.changes(channel)) for channel in MEASURED}
    return Sensors.of(replace(plant, sensors={**plant.sensors, **changed}), seed=measuring.seed, noise=measuring.noise)


def _plant_file(plant: str | Path | Plant | None) -> Path | None:
    """The file of a plant that is given by name, by path or as it is; None where there is none."""
    if isinstance(plant, Plant):
        return plant.path
    return plants.find(plant) if plant else None


def _of_model(word: str, plant: str | Path | Plant | None, model: Model) -> Plant | None:
    """A plant that was loaded already. Raises InputError for its other set of parameters."""
    if not isinstance(plant, Plant):
        return None
    if plant.model != model:
        raise InputError(
            f"{word} is the {plant.model} model of {plant.name}; expected the {model} one, "
            f'load_plant("{plant.name}", model="{model}")'
        )
    return plant


def _is_load(key: str) -> bool:
    """Whether a setting is of the load, by its word or its symbol."""
    return key_of(symbol_of(key)).startswith("load.")


def _known_to_linear(definition: ScenarioFile, plant: Plant) -> dict[str, str]:
    """The settings that the linear set has as well: a scenario may change A_FR, which only the nonlinear one knows."""
    return {key: value for key, value in definition.all_settings.items() if knows(plant, key)}
