"""Types of the public names, which are loaded on first use; arguments that accept names or paths include str, Path."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, overload

import control
import numpy as np
import numpy.typing as npt
import pandas

from .core.catalogue import controllers as controllers
from .core.catalogue import plants as plants
from .core.catalogue import scenarios as scenarios
from .core.controller_interface import Controller, Readings, Setpoint
from .core.errors import EhsaError as EhsaError
from .core.errors import InputError as InputError
from .core.errors import SimulationError as SimulationError
from .core.log import Column
from .core.log import Log as Log
from .design.analysis.loop import LoopAnalysis
from .design.analysis.robustness import RobustMargins
from .design.analysis.system import Analysis
from .design.controller import SampledController
from .design.review import Known as Known
from .design.review import Review
from .design.state_space.mpc_terms import MpcTerms
from .diagnosis.batch import LogBatch
from .diagnosis.changed import Change
from .diagnosis.diagnosis import Diagnosis as Diagnosis
from .diagnosis.law.confirmation import Confirmation
from .fleet.result import Fleet
from .identification.checks import LogFinding
from .identification.comparison import Comparison
from .identification.experiment import ExperimentDesign
from .identification.fit_result import Progress
from .identification.frequency_response import FrequencyResponse, Method
from .identification.identification import Identification
from .identification.predicted_accuracy import PredictedAccuracy
from .identification.preparation import Preparation as Preparation
from .identification.refits import Profile
from .identification.subspace import SubspaceModel
from .plant.conditions import Condition
from .plant.draws import Covariance
from .plant.plant import Model
from .plant.plant import Plant as Plant
from .plant.structure import Structure as Structure
from .report import figures as figures
from .report import style as style
from .scenario.comparison import ControllerComparison
from .scenario.definition import Scenario
from .scenario.learning import LearntReference
from .scenario.montecarlo import MonteCarlo
from .scenario.outcome import Outcome
from .scenario.result import ScenarioResult
from .simulation.closed_loop import ClosedLoop
from .simulation.engine import Batch, Hold
from .simulation.faults import Faults
from .simulation.reference import ReferenceRun
from .simulation.sensitivity import Sensitivities
from .simulation.sensors import Sensors as Sensors
from .simulation.stepped_run import SteppedRun as SteppedRun
from .simulation.trajectory import Trajectory

_PlantLike = Plant | str | Path
_LogLike = Log | str | Path
_SystemLike = control.StateSpace | Plant | str | Path
_Law = Callable[[float, Readings, Setpoint], float]

class _StepsAlone(Protocol):
    def step(self, t: float, y: Readings, r: Setpoint, /) -> float: ...

_ControllerLike = (
    Controller | str | Path | Mapping[str, Any] | control.StateSpace | control.TransferFunction | _Law | _StepsAlone
)
_ScenarioLike = Scenario | str | Path | Mapping[str, Any]
_ArrayLike = npt.NDArray[np.number] | Sequence[float]

__version__: str
__all__: list[str]

def analyse(system: _SystemLike, *, drive_unit: str = "A") -> Analysis: ...
def analyse_loop(
    system: _SystemLike,
    controller: _ControllerLike,
    *,
    lag: int = 0,
    delay: float = 0.0,
    noise: Mapping[str, float] | None = None,
    points: int = 1200,
) -> LoopAnalysis: ...
def check_log(log: _LogLike, plant: _PlantLike) -> tuple[LogFinding, ...]: ...
def conditions(
    *,
    positions: Sequence[float] = (0.0,),
    velocities: Sequence[float] = (0.05,),
    stiffnesses: Sequence[float] = (),
    masses: Sequence[float] = (),
    betas: Sequence[float] = (),
) -> list[Condition]: ...
def design_experiment(
    plant: _PlantLike,
    *,
    duration: float = 20.0,
    kind: str = "best",
    free: str | Iterable[str] = (),
    fix: str | Iterable[str] = (),
    amplitude: float | None = None,
    criterion: str = "worst",
    margin: float = 0.15,
    spread: float = 0.3,
    draws: int = 8,
    rehearsals: int = 6,
    seed: int = 0,
    jobs: int | None = None,
    watch: Callable[[str, int, int], None] | None = None,
) -> ExperimentDesign: ...
def confirm_law(
    plant: _PlantLike,
    name: str,
    logs: _LogLike | Sequence[_LogLike],
    *,
    threshold: float = 0.03,
    watch: Callable[[str, int, int], None] | None = None,
) -> Confirmation: ...
def diagnose(
    plant: _PlantLike,
    log: _LogLike | Sequence[_LogLike],
    *,
    validate: _LogLike | None = None,
    threshold: float = 0.03,
    jobs: int | None = None,
    watch: Callable[[str, int, int], None] | None = None,
    check: bool = True,
    without: Collection[str] = (),
) -> Diagnosis: ...
def analyse_fleet(
    plant: _PlantLike,
    logs: str | Path | Sequence[str | Path],
    *,
    store: str | Path,
    by: str = "",
    rate: float = 0.05,
    diagnose: bool = True,
    check: bool = True,
    jobs: int | None = None,
    watch: Callable[[str, int, int], None] | None = None,
    truth: Mapping[str, Mapping[str, str]] | None = None,
    keep: Callable[[str, Diagnosis], None] | None = None,
) -> Fleet: ...
def query_store(folder: str | Path, text: str) -> pandas.DataFrame: ...
def diagnose_many(
    plant: _PlantLike,
    logs: Sequence[str | Path | Log],
    *,
    threshold: float = 0.03,
    check: bool = True,
    jobs: int | None = None,
    file: str | Path | None = None,
    anew: bool = False,
    watch: Callable[[int, int], None] | None = None,
    keep: Callable[[str, Diagnosis], None] | None = None,
) -> LogBatch: ...
def draw(
    plant: _PlantLike,
    n: int,
    *,
    seed: int = 0,
    within: float = 2.0,
    covariance: Covariance | None = None,
    names: str | Iterable[str] | None = None,
    unknown: float = 0.0,
    assumed: bool = False,
) -> list[Plant]: ...
def drawn_models(
    plant: _PlantLike, plants: Iterable[Plant], conditions: Sequence[Condition] = ...
) -> dict[str, control.StateSpace]: ...
def excitation(
    name: str, *, amplitude: float = 1.5, duration: float = 10.0, sample_time: float = 0.004, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]: ...
def export_fmu(plant: _PlantLike, path: str | Path, *, force: bool = False) -> Path: ...
def fit_percent(measured: _ArrayLike, simulated: _ArrayLike) -> float: ...
def forecast(
    plant: _PlantLike,
    time: _ArrayLike,
    current: _ArrayLike,
    *,
    free: str | Iterable[str] = (),
    fix: str | Iterable[str] = (),
    centre: bool = False,
) -> PredictedAccuracy: ...
def four_state(plant: _PlantLike) -> control.StateSpace: ...
def frequency_response(
    plant: _PlantLike,
    logs: _LogLike | Sequence[_LogLike],
    *,
    models: Mapping[str, control.StateSpace] | None = None,
    method: Method = "auto",
    estimator: str = "H1",
    segment: float | None = None,
    period: float | None = None,
    settle: float | None = None,
    subspace: bool = False,
    order: int | None = None,
) -> FrequencyResponse: ...
def gap(plant: _PlantLike, log: _LogLike) -> dict[str, float]: ...
def hunting(time: _ArrayLike, x: _ArrayLike) -> dict[str, float]: ...
def identify(
    plant: _PlantLike,
    logs: _LogLike | Sequence[_LogLike],
    *,
    validate: Sequence[_LogLike] | str | Path = (),
    free: str | Iterable[str] = (),
    fix: str | Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, float | None] | None = None,
    method: Literal["simulation", "balances"] | None = None,
    window: float | None = None,
    starts: int = 6,
    seed: int = 0,
    watch: Callable[[Progress], None] | None = None,
    check: bool = True,
) -> Identification: ...
def identify_subspace(
    drive: _ArrayLike, outputs: Mapping[str, _ArrayLike], sample_time: float, *, order: int | None = None
) -> SubspaceModel: ...
def known_of(plant: _PlantLike) -> Known: ...
def learn_reference(
    scenario: _ScenarioLike,
    *,
    controller: _ControllerLike | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
    trials: int = 8,
    gain: float = 0.5,
    cutoff: float = 10.0,
    lead: int | None = None,
    deadband: float = 0.0,
) -> LearntReference: ...
def linearise(
    plant: _PlantLike, *, position: float = 0.0, pressure_level: float | None = None, velocity: float = 0.05
) -> control.StateSpace: ...
def log_controller(plant: _PlantLike, controller: str | Path | None = None) -> SampledController: ...
def load_controller(
    name: _ControllerLike,
    system: _SystemLike | None = None,
    *,
    sample_time: float | None = None,
    method: str = "tustin",
    label: str = "",
    problem: Callable[[MpcTerms], Any] | None = None,
    compiled: bool | None = None,
    **keys: Any,
) -> SampledController: ...
def load_plant(
    name: str | Path, *, model: Model = "nonlinear", settings: Mapping[str, str | float] | None = None
) -> Plant: ...
def load_scenario(name: str | Path | Mapping[str, Any], *, label: str = "", **keys: Any) -> Scenario: ...
def monte_carlo(
    scenario: _ScenarioLike,
    *,
    runs: int = 1000,
    seed: int = 0,
    controller: _ControllerLike | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
    identification: str | Path | None = None,
    jobs: int | None = None,
    file: str | Path | None = None,
    anew: bool = False,
    watch: Callable[[int, int], None] | None = None,
) -> MonteCarlo: ...
def motion_current(plant: _PlantLike) -> dict[str, float]: ...
def profile(found: Identification, name: str) -> Profile: ...
def read_log(
    path: str | Path,
    required: str | Sequence[str],
    *,
    columns: Mapping[str, Column] | None = None,
    shortest: int = 2,
    uniform: bool = True,
    wanted: str | Sequence[str] = (),
    span: tuple[float | None, float | None] = (None, None),
    sample_time: float | None = None,
    rate: float | None = None,
    held: str | Collection[str] = (),
) -> Log: ...
def read_plant_log(
    path: str | Path,
    plant: _PlantLike,
    *,
    uniform: bool = True,
    span: tuple[float | None, float | None] = (None, None),
    sample_time: float | None = None,
    rate: float | None = None,
) -> Log: ...
def record(
    plant: _PlantLike,
    time: _ArrayLike,
    current: _ArrayLike,
    *,
    seed: int = 0,
    sensor_noise: bool = True,
    centre: bool = False,
    tolerance: float = 1e-06,
    force: _ArrayLike | None = None,
) -> tuple[Log, Trajectory]: ...
def replay_closed_loop(
    diagnosis: Diagnosis, controller: _ControllerLike, *, validate: Log | None = None
) -> Diagnosis: ...
def replay(plant: _PlantLike, log: _LogLike) -> Comparison: ...
def review(
    system: _SystemLike,
    controller: _ControllerLike,
    *,
    known: Known | None = None,
    robust: RobustMargins | None = None,
    lag: int = 0,
) -> Review: ...
def robust_margins(
    systems: Mapping[str, control.StateSpace],
    controller: _ControllerLike,
    *,
    lag: int = 0,
    delay: float = 0.0,
    points: int = 300,
) -> RobustMargins: ...
@overload
def run(
    scenario: _ScenarioLike,
    *,
    controller: list[Any] | tuple[Any, ...],
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
    draw: Outcome | None = None,
) -> ControllerComparison: ...
@overload
def run(
    scenario: _ScenarioLike,
    *,
    controller: _ControllerLike | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
    draw: Outcome | None = None,
) -> ScenarioResult: ...
def run_closed_loop(
    plant: _PlantLike,
    controller: _ControllerLike,
    reference: _ArrayLike,
    *,
    force: _ArrayLike | None = None,
    sensors: Sensors | None = None,
    lag: int = 0,
    faults: Faults | None = None,
    start: _ArrayLike | None = None,
    tolerance: float = 1e-06,
    compiled: bool | None = None,
    raise_on_failure: bool = True,
) -> ClosedLoop: ...
def sensitivities(
    plant: _PlantLike,
    parameters: str | Sequence[str],
    current: _ArrayLike,
    *,
    initial_states: str | Sequence[str] = (),
    force: _ArrayLike | None = None,
    hold: Hold = "zero_order",
    start: _ArrayLike | None = None,
    sample_time: float | None = None,
    tolerance: float = 1e-06,
) -> Sensitivities: ...
def shortest_time(
    plant: _PlantLike,
    distance: float,
    current_limit: float,
    *,
    start: float = 0.0,
    band: float = 0.0,
    speed_limit: float | None = None,
) -> float: ...
def simulate(
    plant: _PlantLike,
    current: _ArrayLike | control.TimeResponseData,
    *,
    force: _ArrayLike | None = None,
    hold: Hold = "zero_order",
    start: _ArrayLike | None = None,
    sample_time: float | None = None,
    tolerance: float = 1e-06,
    raise_on_failure: bool = True,
) -> Trajectory: ...
def simulate_batch(
    plant: _PlantLike,
    parameters: _ArrayLike,
    current: _ArrayLike,
    *,
    force: _ArrayLike | None = None,
    hold: Hold = "zero_order",
    start: _ArrayLike | None = None,
    sample_time: float | None = None,
    tolerance: float = 0.0001,
    jobs: int | None = None,
) -> Batch: ...
def simulate_reference(
    plant: _PlantLike,
    current: _ArrayLike,
    *,
    force: _ArrayLike | None = None,
    hold: Hold = "zero_order",
    start: _ArrayLike | None = None,
    sample_time: float | None = None,
    method: str = "DOP853",
    rtol: float = 1e-10,
) -> ReferenceRun: ...
def sliding_linear(plant: _PlantLike) -> Plant: ...
def slip_quantum(
    plant: _PlantLike, *, width: float | None = None, direction: int = 1, excess: float = 0.001
) -> float: ...
def three_state(plant: _PlantLike, *, position: bool = True) -> control.StateSpace: ...
def to_iosystem(plant: _PlantLike) -> control.NonlinearIOSystem: ...
def what_changed(
    plant: _PlantLike,
    before: _LogLike,
    after: _LogLike,
    *,
    threshold: float = 0.03,
    jobs: int | None = None,
    watch: Callable[[str, int, int], None] | None = None,
    check: bool = True,
    without: Collection[str] = (),
) -> Change: ...
def write_plant(path: str | Path, *plants: _PlantLike, force: bool = False) -> Path: ...
def write_report(result: Any, folder: str | Path, *, force: bool = False) -> Path: ...
