"""Prepare scenarios: load files, design the controller, simulate, evaluate limits; validate definition files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.catalogue import controllers, plants
from ..core.controller_interface import MEASURED, Controller
from ..core.errors import InputError
from ..core.files import read_toml
from ..core.registry import add_project
from ..design.controller import SampledController
from ..design.load import load_controller, read_controller
from ..physics.effects import read_law
from ..plant.conditions import linear_model
from ..plant.file import key_of, symbol_of
from ..plant.load import has_setting, load_plant, models_of, with_settings
from ..plant.plant import Model, Plant
from ..simulation.closed_loop import ClosedLoop, run_closed_loop
from ..simulation.sensors import Sensors
from .baseline_file import baseline_files, read_baseline
from .definition import Scenario, load_scenario, require_drive_unit
from .disturbances import faults_of
from .log_controller import log_controller
from .metrics import METRICS, loop_metrics
from .plant_data import check_controller_limits, own_controller, plant_with_drive
from .result import LimitCheck, failures_of
from .uncertainty import uncertainty_of

if TYPE_CHECKING:
    import control

#: Largest number of samples of a scenario, 67 min at 250 Hz; a longer one probably has a wrong time unit.
MAX_SAMPLES = 1_000_000


class Evaluation(NamedTuple):
    """Metrics of a run (SI units), the checked limits, and the failures as sentences."""

    metrics: dict[str, float]
    checks: tuple[LimitCheck, ...]
    failures: tuple[str, ...]


@dataclass(frozen=True)
class PreparedScenario:
    """A scenario with its plants and its designed controller, ready to run.

    Attributes
    ----------
    model: linear design model.
    linear, nonlinear: plants with the scenario's settings, for the prediction and the check.
    files: input files. settings: plant parameters of this run, in addition to the scenario's own.
    """

    scenario: Scenario
    controller: Controller
    model: control.StateSpace
    linear: Plant
    nonlinear: Plant
    files: tuple[Path, ...] = ()
    settings: Mapping[str, str | float] = field(default_factory=dict)

    def simulate(self, plant: Plant, seed: int | None = None, correction: np.ndarray | None = None) -> ClosedLoop:
        """Simulate the scenario on a plant.

        seed: instead of the scenario's seed of the sensor noise. correction: (N,) m, added to the reference's position;
        empty for none.

        Raises SimulationError for a run that stops although no plant limit was exceeded.
        """
        definition = self.scenario.definition
        dt = self.controller.sample_time
        time = dt * np.arange(int(round(definition.duration / dt)) + 1)
        force = np.zeros(time.size)
        for step in definition.disturbance:
            force[(time >= step.start - 1e-9) & (time < step.start + step.duration - 1e-9)] += step.force
        rows = definition.reference.rows(time)
        if correction is not None and correction.size:
            rows[:, 0] += correction
        settings = definition.sensors
        there = [channel for channel in MEASURED if channel in plant.sensors]
        changed = {channel: replace(plant.sensors[channel], **settings.changes(channel)) for channel in there}
        measured = replace(plant, sensors={**plant.sensors, **changed})
        loop = run_closed_loop(
            plant,
            self.controller,
            rows,
            force=force,
            sensors=Sensors.of(measured, seed=settings.seed if seed is None else seed, noise=settings.noise),
            lag=settings.lag,
            faults=faults_of(definition.fault),
            raise_on_failure=False,
        )
        loop.trajectory.explained()
        return loop

    def metrics(self, loop: ClosedLoop, wanted: tuple[str, ...] | None = None) -> dict[str, float]:
        """All of METRICS for a run; `wanted` omits the slow ones (ShortestTime, SettlingRatio) unless it names one."""
        definition = self.scenario.definition
        return loop_metrics(
            loop,
            jumps=[at for at in definition.reference.jumps() if at < definition.duration],
            holds=definition.holds(),
            current_limit=float(getattr(self.controller, "current_limit", np.inf)),
            first_fault=definition.first_fault,
            lag=definition.sensors.lag,
            force_changes=[one for one in definition.reference.force_changes() if one.start < definition.duration],
            cycles=definition.cycles(),
            impedance=getattr(getattr(self.controller, "law", None), "impedance", None),
            shortest=wanted is None or bool({"ShortestTime", "SettlingRatio"} & {*wanted}),
        )

    def evaluate(self, loop: ClosedLoop, *, every_metric: bool = False) -> Evaluation:
        """Metrics, limits and failures of a run; slow metrics only with `every_metric` or where one is limited."""
        definition = self.scenario.definition
        metrics = self.metrics(loop, wanted=None if every_metric else tuple(definition.limits))
        checks = self.check_limits(metrics)
        return Evaluation(metrics, checks, failures_of(checks, loop.trajectory, definition.expect_trips))

    @property
    def metric_units(self) -> dict[str, str]:
        """Name -> SI unit of every metric."""
        return {name: metric.unit for name, metric in METRICS.items()}

    def check_limits(self, metrics: Mapping[str, float]) -> tuple[LimitCheck, ...]:
        """Check metrics [SI units] against the scenario's limits."""
        limits = self.scenario.definition.limits
        return tuple(LimitCheck(name, metrics[name], bound.min, bound.max) for name, bound in limits.items())


def prepare(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    controller: Any = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
) -> PreparedScenario:
    """Load a scenario with its plant and controller, and design the controller; arguments and errors as in `run`."""
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    definition, beside = loaded.definition, loaded.path
    given = dict(settings or {})
    try:
        nominal = _given_plant("plant", plant, "nonlinear")
        base = _given_plant("design", design, "linear")
        if not (nominal and nominal.path) and not definition.plant:
            raise InputError("names no plant; give one, run(scenario, plant=...)")
        file = (nominal and nominal.path) or plants.find(definition.plant, beside=beside)
        reason = load_plant(file, model=models_of(file)[0]).structure.system.no_controller
        if reason:
            raise InputError(f"{file}: {reason}; scenarios are for plants whose drive a controller computes")
        base = base or load_plant(file, model="linear")
        nominal = nominal or load_plant(file, model="nonlinear")
        model, unit = linear_model(base), nominal.structure.system.drive_unit
        law: Controller
        controller_file = None
        if controller is None or isinstance(controller, str | Path):
            if not controller and not definition.controller:
                raise InputError("names no controller; give one, run(scenario, controller=...)")
            named = controllers.find(controller) if controller else None
            controller_file = named or controllers.find(definition.controller, beside=beside)
            read = read_controller(controller_file, base.sample_time, unit)[1]
            check_controller_limits(controller_file, read, nominal)
            law = load_controller(controller_file, model, sample_time=base.sample_time)
        elif isinstance(controller, Controller):
            law = controller
        else:
            law = own_controller(controller, nominal, model)
        # A scenario may set parameters that only the nonlinear set has, such as A_FR.
        shared = {key: value for key, value in definition.all_settings.items() if has_setting(base, key)}
        linear, nonlinear = with_settings(base, shared), with_settings(nominal, definition.all_settings)
    except InputError as error:
        raise InputError(f"{loaded.path or loaded.name}: {error}") from None
    require_drive_unit(loaded, unit)
    _check_length(loaded, law)
    _check_force(loaded, law)
    if definition.supervision is not None and isinstance(law, SampledController):
        law = replace(law, supervision=definition.supervision.for_plant(linear))
    # The load acts on both runs; the other settings change only the simulated plant.
    loads = {key: value for key, value in given.items() if key_of(symbol_of(key)).startswith("load.")}
    files = dict.fromkeys(f for f in (loaded.path, controller_file, nominal.path, base.path) if f is not None)
    return PreparedScenario(
        loaded, law, model, with_settings(linear, loads), with_settings(nonlinear, given), tuple(files), given
    )


def _given_plant(word: str, plant: str | Path | Plant | None, model: Model) -> Plant | None:
    """The plant of an argument; None without one. Raises InputError for a plant object with the other parameter set."""
    if not isinstance(plant, Plant):
        return load_plant(plant, model=model) if plant else None
    if plant.model != model:
        raise InputError(
            f"{word} is the {plant.model} model of {plant.name}; expected the {model} one, "
            f'load_plant("{plant.name}", model="{model}")'
        )
    return plant


def _check_force(scenario: Scenario, controller: Controller) -> None:
    """Raise InputError for a force target beyond the controller's limit."""
    law = getattr(controller, "law", None)
    limit = getattr(law, "limit", np.inf) if getattr(law, "follows_force", False) else np.inf
    force = scenario.definition.reference.force
    if force is not None and force.largest > limit:
        raise InputError(
            f"{scenario.path or scenario.name}: [reference] a force of {force.largest:g} N is beyond the limit of "
            f"{controller.name}, {limit:g} N; lower it, or raise [force] limit as far as current and pressures allow"
        )


def _check_length(scenario: Scenario, controller: Controller) -> None:
    """Raise InputError for too many samples, or for a lag that is as long as the run."""
    definition, where = scenario.definition, scenario.path or scenario.name
    samples = definition.duration / controller.sample_time
    if samples > MAX_SAMPLES:
        raise InputError(
            f"{where}: duration = {definition.duration:g} s is {samples:.3g} samples of {controller.name}, whose "
            f"sample_time is {controller.sample_time:g} s; expected at most {MAX_SAMPLES}"
        )
    if definition.sensors.lag >= samples:
        raise InputError(
            f"{where}: [sensors] lag = {definition.sensors.lag} samples is as long as the run, {samples:.4g} samples; "
            "increase duration or reduce lag"
        )


def with_drive_of(names: Sequence[str], plant: str | Path | None, given: Sequence[str | Path]) -> list[str]:
    """The scenarios whose own plant has a drive in the unit of this plant's and these controllers' drives.

    A scenario whose own plant can't be read stays.
    """
    limits = [read_toml(controllers.find(name)).get("current_limit") for name in given]
    asked = {_drive_unit(one) for one in (*([plant] if plant else []), *map(plant_with_drive, limits))}
    return [name for name in names if not (unit := own_drive_unit(name)) or asked <= {unit}]


def own_drive_unit(scenario: str | Path) -> str:
    """SI unit of the drive of the scenario's own plant; empty if that can't be read."""
    with suppress(InputError):
        loaded = load_scenario(scenario)
        return _drive_unit(plants.find(loaded.definition.plant, beside=loaded.path))
    return ""


def _drive_unit(plant: str | Path) -> str:
    """SI unit of a plant's drive."""
    file = plants.find(plant)
    return load_plant(file, model=models_of(file)[0]).structure.system.drive_unit


def check_definition(path: Path, *, plant: str | Path | None = None) -> str:
    """Validate a definition file and return its kind: "plant", "controller", "scenario" or "effect".

    Parameters
    ----------
    plant: for a controller, the plant on whose linear model it is designed and whose ratings it must respect; by
        default the model of the shipped plant with its drive, without its ratings. For an effect, the plant that it
        must fit; by default none.

    Raises InputError with file and key for the first error: schema, unit, value, unknown name, failed design.
    """
    content = read_toml(path)
    if "system" in content:
        for model in models_of(path):
            if load_plant(path, model=model).log_controller is not None:
                log_controller(load_plant(path, model=model))
        return "plant"
    if "kind" in content:
        loaded = load_plant(plant or plant_with_drive(content.get("current_limit")), model="linear")
        if plant is not None:
            read = read_controller(path, loaded.sample_time, loaded.structure.system.drive_unit)[1]
            check_controller_limits(path, read, loaded)
        load_controller(path, linear_model(loaded), sample_time=loaded.sample_time)
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
    if "expression" in content:
        effect = read_law(path)
        if plant is not None:
            add_project(path)
            load_plant(plant).with_effects(effect.name)
        return "effect"
    raise InputError(
        f"{path}: is neither a plant (system = ...) nor a controller (kind = ...) nor a scenario (why = ...) nor an "
        "effect (expression = ...)"
    )
