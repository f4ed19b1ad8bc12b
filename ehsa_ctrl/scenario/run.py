"""Run a scenario: design on the identified linear model, simulate on the nonlinear plant, compare, check limits."""

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
from ..core.files import read_toml
from ..design.analysis.loop import analyse_loop
from ..design.controller import SampledController
from ..design.load import load_controller, read_controller
from ..plant.file import key_of, symbol_of
from ..plant.linear import three_state
from ..plant.load import has_setting, load_plant, with_settings
from ..plant.plant import Model, Plant
from ..simulation.closed_loop import ClosedLoop, run_closed_loop
from ..simulation.sensors import Sensors
from .baseline import baseline_files, baseline_path, read_baseline
from .definition import Scenario, ScenarioFile, load_scenario
from .disturbances import SensorSettings, faults_of
from .metrics import METRICS, loop_metrics
from .plant_data import check_controller_limits
from .result import LimitCheck, ScenarioResult
from .sensitivity import assumption_sensitivity
from .uncertainty import uncertainty_of

if TYPE_CHECKING:
    import control


#: Most samples of a scenario, more than an hour at 250 Hz; a longer one has a wrong time unit.
MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class PreparedScenario:
    """A scenario with its plants and its designed controller, ready to run.

    Attributes
    ----------
    model: linear model on which the controller was designed.
    linear, nonlinear: plants with the scenario's settings, for the prediction and the check.
    files: from which all this was read. settings: set for this run, in addition to the scenario's own.
    """

    scenario: Scenario
    controller: Controller
    model: control.StateSpace
    linear: Plant
    nonlinear: Plant
    files: tuple[Path, ...] = ()
    settings: Mapping[str, str | float] = field(default_factory=dict)

    def simulate(self, plant: Plant, seed: int | None = None) -> ClosedLoop:
        """Simulate the scenario on a plant, with the scenario's seed of the sensor noise or another one.

        Raises SimulationError for a run that stops although no limit of the plant was exceeded.
        """
        definition = self.scenario.definition
        dt = self.controller.sample_time
        time = dt * np.arange(int(round(definition.duration / dt)) + 1)
        force = np.zeros(time.size)
        for step in definition.disturbance:
            force[(time >= step.start - 1e-9) & (time < step.start + step.duration - 1e-9)] += step.force
        settings = definition.sensors if seed is None else definition.sensors.model_copy(update={"seed": seed})
        loop = run_closed_loop(
            plant,
            self.controller,
            definition.reference.signal(time),
            force=force,
            sensors=_sensors(plant, settings),
            lag=definition.sensors.lag,
            faults=faults_of(definition.fault),
            raise_on_failure=False,
        )
        loop.trajectory.explained()
        return loop

    def metrics(self, loop: ClosedLoop, wanted: tuple[str, ...] | None = None) -> dict[str, float]:
        """All of METRICS for a run; with `wanted`, the slow ones only if they are among these."""
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

    def check_limits(self, metrics: Mapping[str, float]) -> tuple[LimitCheck, ...]:
        """Check these metrics against the scenario's limits."""
        limits = self.scenario.definition.limits
        return tuple(LimitCheck(name, metrics[name], bound.min, bound.max) for name, bound in limits.items())


def prepare(
    scenario: str | Path | Scenario,
    *,
    controller: str | Path | Controller | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
) -> PreparedScenario:
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
            check_controller_limits(law, read_controller(law, base.sample_time)[1], nominal)
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
        chosen = replace(chosen, supervision=definition.supervision.for_plant(linear))
    given = dict(settings or {})
    # The load acts in both runs; the other settings change only the plant that is checked on.
    nonlinear = with_settings(nonlinear, given)
    linear = with_settings(linear, {key: value for key, value in given.items() if _is_load(key)})
    files = [loaded.path, law if isinstance(law, Path) else None, checked, designed]
    known = tuple(dict.fromkeys(Path(file) for file in files if file is not None))
    return PreparedScenario(loaded, chosen, model, linear, nonlinear, known, given)


def run(
    scenario: str | Path | Scenario,
    *,
    controller: str | Path | Controller | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
) -> ScenarioResult:
    """Run a scenario: linear prediction, nonlinear check, comparison, limits.

    The controller is designed on the identified linear set of the plant's file; the scenario's load, disturbances and
    faults act in both runs.

    Parameters
    ----------
    scenario: a name, a path, or a loaded scenario. Files that it names are looked for beside its own file first.
    controller, plant: replace those that the scenario names. A designed controller, from `load_controller` or a
        user's own, runs as it is and is compared with no baseline. A loaded, changed or identified plant is used as it
        is, with the scenario's load and settings; the controller is designed on the linear set of its file.
    design: plant whose linear set is used for design and prediction, if it differs from the plant that is simulated:
        the rig's identified model against the plant that counts as true.
    assumed: also run with each assumed parameter at both ends of its range; None: only with a compiled controller,
        where this is quick.
    settings: parameters of the simulated plant in this run, as for `load_plant`, in addition to the scenario's own:
        {"K_T": 1.1, "load.stiffness": "50 N/mm"}. A load acts in the prediction too; the controller and the rest of
        the prediction keep the linear set. Such a run is compared with no baseline.

    Raises
    ------
    InputError: a definition is wrong or refers to something that does not exist.
    SimulationError: a run stops although no limit of the plant was exceeded.
    """
    begun = clock.perf_counter()
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    loops = [case.simulate(model) for model in (case.linear, case.nonlinear)]
    loops = [loop.first(min(len(other.trajectory) for other in loops)) for loop in loops]
    predicted, outcome = (case.metrics(loop) for loop in loops)
    result = ScenarioResult(
        scenario=case.scenario,
        controller=case.controller,
        linear=loops[0],
        nonlinear=loops[1],
        metrics={name: (predicted[name], outcome[name]) for name in METRICS},
        limit_checks=case.check_limits(outcome),
        trips=loops[1].trajectory.exceeded,
        loop=analyse_loop(case.model, case.controller) if isinstance(case.controller, SampledController) else None,
        seconds=clock.perf_counter() - begun,
        files=case.files,
        settings=case.settings,
    )
    if assumed or (assumed is None and case.controller.compiled is not None):
        result = replace(result, sensitivities=assumption_sensitivity(case, kept=not result.limit_failures))
    # A baseline belongs to the scenario's own plant and to a controller from a file.
    recorded = not plant and not design and not settings and (controller is None or isinstance(controller, str | Path))
    path = baseline_path(result) if recorded else None
    return replace(result, baseline=read_baseline(path) if path and path.is_file() else None)


def _sensors(plant: Plant, settings: SensorSettings) -> Sensors:
    """The plant's sensors with the scenario's changes."""
    changed = {channel: replace(plant.sensors[channel], **settings.changes(channel)) for channel in MEASURED}
    return Sensors.of(replace(plant, sensors={**plant.sensors, **changed}), seed=settings.seed, noise=settings.noise)


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
    return {key: value for key, value in definition.all_settings.items() if has_setting(plant, key)}


def check_definition(path: Path, *, plant: str | Path | None = None) -> str:
    """Return the kind ("plant", "controller", "scenario") of a valid definition.

    Parameters
    ----------
    plant: on whose linear model a controller is designed as a check, and whose limits it must respect; by default the
        shipped EHSA's model, and no limits.

    Raises InputError, one sentence with file and key, for the first mistake: form, unit, value, a name that does not
    exist, a controller that can't be designed.
    """
    content = read_toml(path)
    if "system" in content:
        for model in ("linear", "nonlinear"):
            if model in content:
                load_plant(path, model=model)
        if "linear" not in content and "nonlinear" not in content:
            raise InputError(f"{path}: has neither a [linear] nor a [nonlinear] model")
        return "plant"
    if "kind" in content:
        loaded = load_plant(plant or "ehsa", model="linear")
        if plant is not None:
            check_controller_limits(path, read_controller(path, loaded.sample_time)[1], loaded)
        load_controller(path, three_state(loaded), sample_time=loaded.sample_time)
        return "controller"
    if "why" in content or "reference" in content:
        scenario = load_scenario(path)
        case = prepare(scenario)
        try:
            uncertainty_of(case.nonlinear, scenario.definition.spread)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        for file in baseline_files(scenario):
            read_baseline(file)
        return "scenario"
    raise InputError(f"{path}: is no plant (system = ...), no controller (kind = ...) and no scenario (why = ...)")
