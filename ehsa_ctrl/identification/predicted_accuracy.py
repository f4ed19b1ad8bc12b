"""Accuracy to expect from a planned input: the covariance by linear theory, and its check on simulated logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from ..core.errors import EhsaError, InputError, SimulationError, choices
from ..core.log import Log
from ..core.result import Result, as_table
from ..plant.file import label
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.sensors import noise_free_reading
from ..simulation.trajectory import Trajectory
from .fit_result import Diverged, Fit
from .gauss_newton import fit
from .parameters import FreeParameter, free_parameters
from .shooting import ShootingWindow, shooting_windows
from .uncertainty import POOR, Estimate, ParameterCovariance, estimates, parameter_covariance

if TYPE_CHECKING:
    import pandas

#: A check fails if errors as large have a lower probability than this under the predicted covariance.
RARE = 0.01
#: A check that fails clearly ends after this many logs, because a fit along such a run takes long.
FIRST = 2


@dataclass(frozen=True, repr=False)
class PredictedAccuracy(Result):
    """Standard deviations to expect from an input.

    run: the nominal plant under the input, without noise. estimates: one row a free parameter with its nominal value.
    uncertainty: covariance and correlation. sizes (k,): what each standard deviation is compared with.
    """

    run: Trajectory = field(repr=False)
    estimates: tuple[Estimate, ...]
    uncertainty: ParameterCovariance
    fit: Fit = field(repr=False)
    sizes: np.ndarray

    def __getitem__(self, name: str) -> Estimate:
        """The row of a parameter. Raises InputError for one that is not free."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise InputError(f"{name} is not free; {choices(name, [e.name for e in self.estimates])}")

    def scaled(self, factor: float) -> PredictedAccuracy:
        """The same with every sd multiplied by `factor`, the result of a Monte Carlo check; `fit` is unchanged."""
        found = replace(self.uncertainty, covariance=factor**2 * self.uncertainty.covariance)
        return replace(self, estimates=estimates(self.fit, found, self.sizes), uncertainty=found)

    @property
    def relative(self) -> dict[str, float]:
        """Name -> sd over the parameter's size; infinite where the log shows nothing."""
        return {
            e.name: e.sd / size if size > 0.0 else np.inf for e, size in zip(self.estimates, self.sizes, strict=True)
        }

    @property
    def undetermined(self) -> dict[str, tuple[str, ...]]:
        """Parameters that the log would not determine -> the parameters that each trades off against."""
        return {
            e.name: e.trades
            for e, size in zip(self.estimates, self.sizes, strict=True)
            if not np.isfinite(e.sd) or (size > 0.0 and e.sd > POOR * size)
        }

    def table(self, worst: Mapping[str, float] | None = None) -> str:
        """Rows: parameter, nominal value, expected sd, relative, `worst` (another relative sd), and remarks."""
        relative = self.relative
        more = "" if worst is None else f" {'at worst':>9}"
        lines = [f"  {'':<14} {'nominal':>11} {'expected sd':>12} {'relative':>9}{more}  unit"]
        for e in self.estimates:
            sd = f"{e.sd:.2g}" if np.isfinite(e.sd) else "-"
            share = f"{percent(relative[e.name]):>9}" + ("" if worst is None else f" {percent(worst[e.name]):>9}")
            words = "" if e.verdict == "well determined" else e.verdict.replace("this log", "this input")
            if relative[e.name] == np.inf and np.isfinite(e.sd):
                words = "nominally zero, so that it has no relative sd"
            if e.trades and words:
                words += f", trades with {', '.join(map(label, e.trades))}"
            lines.append(f"  {label(e.name):<14} {e.value:>11.5g} {sd:>12} {share}  {e.unit:<10} {words}".rstrip())
        return "\n".join(lines)

    def to_pandas(self) -> pandas.DataFrame:
        """One row a parameter: nominal value, expected sd, absolute and relative, and what it trades off against."""
        relative = self.relative
        return as_table(
            self.estimates,
            "unit believed sd relative_sd verdict trades_with",
            believed=lambda e: e.value,
            relative_sd=lambda e: relative[e.name],
            trades_with=lambda e: ", ".join(e.trades),
        )

    def __str__(self) -> str:
        return self.table()


def percent(value: float) -> str:
    """Two significant figures of a relative sd; a dash from 1000 % on."""
    return f"{100 * value:.2g} %" if value < 10 else "-"


def forecast(
    plant: Plant,
    time: np.ndarray,
    current: np.ndarray,
    *,
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    centre: bool = False,
) -> PredictedAccuracy:
    """Standard deviations that `identify` will give for a log of this current, if the plant is the nominal one.

    From the information matrix of the estimator (see `gauss_newton.fit`): derivatives of a run from rest, whitened with
    the noise of the sensors and of the logged input, the initial state eliminated.

    Parameters
    ----------
    time, current: (N,) s and A, uniformly sampled, from rest.
    free, fix: as for `identify`.
    centre: with the bench's slow loop around the rod.

    Raises
    ------
    InputError: as `free_parameters`; a sensor without noise; a current that ends the run early.
    """
    _, run = record(plant, time, current, sensor_noise=False, centre=centre)
    if run.stopped:
        raise InputError(f"the current can't be applied to its end: {run.stopped}; make it smaller or add the centring")
    return predict_accuracy(run, free_parameters(plant, free=free, fix=fix))


def predict_accuracy(run: Trajectory, parameters: Sequence[FreeParameter]) -> PredictedAccuracy:
    """As `forecast`, for an existing run from rest, at the parameter values of its plant.

    Raises SimulationError if the run can't be repeated with derivatives.
    """
    plant, states = run.plant, run.plant.structure.equations.states
    log = _noise_free_log(run)
    parameters = [p if p.sensor else replace(p, value=plant[p.name]) for p in parameters]
    known = {contact.velocity for contact in plant.structure.system.contacts}
    unknown = tuple(i for i, s in enumerate(states) if s.name not in known and not s.name.startswith("z_"))
    window = ShootingWindow(log, 0, len(log) - 1, plant.rest, unknown, np.full(len(states), np.inf))
    # No step: the information at the nominal values is wanted.
    here = fit(plant, [window], parameters, steps=0)
    if isinstance(here, Diverged):
        raise SimulationError(str(here))
    covariance = parameter_covariance(here)
    sizes = np.array([p.reference_size(p.value, [log]) for p in parameters])
    return PredictedAccuracy(run, estimates(here, covariance, sizes), covariance, here, sizes)


def logged_channels(plant: Plant) -> tuple[str, ...]:
    """Drives and outputs of a log of this plant.

    A velocity whose sensor has no noise in the plant's file is not logged if the position is: it would be exact.
    """
    system = plant.structure.system
    exact = {
        channel
        for channel, state in system.outputs.items()
        if not plant.sensors[channel].sd > 0.0 and system.slopes.get(state) in system.outputs.values()
    }
    return tuple(name for name in (*system.drives.values(), *system.outputs) if name not in exact)


def _noise_free_log(run: Trajectory) -> Log:
    """The outputs of the sensors in `logged_channels` along a run, without noise and converter steps."""
    plant, system = run.plant, run.plant.structure.system
    signals = {**{channel: signal for signal, channel in system.drives.items()}, **system.outputs}
    channels = {}
    for channel, signal in signals.items():
        sensor = plant.sensors[channel]
        if channel not in logged_channels(plant):
            continue
        if channel in system.outputs and not sensor.sd > 0.0:
            raise InputError(
                f"{plant.path or plant.name}: gives no noise of {channel}, on which all standard deviations depend; "
                f"give noise in [sensors.{channel}]"
            )
        held = run.hold == "zero_order" and channel not in system.outputs
        channels[channel] = noise_free_reading(sensor, run[signal], float(run.time[1] - run.time[0]), held=held)
    return Log(run.time, channels)


@dataclass(frozen=True)
class MonteCarloCheck:
    """Check of predicted standard deviations on simulated noisy logs.

    ratio: RMS error of the estimates in predicted standard deviations. logs: their number.
    """

    ratio: float
    logs: int
    passed: bool

    def __str__(self) -> str:
        words = (
            "as the linear theory predicts"
            if self.passed
            else "more than it predicts: the run depends on events that noise can change"
        )
        return f"{self.logs} rehearsals: errors {self.ratio:.2f} times the expected sd, {words}"


def check_accuracy(
    predicted: PredictedAccuracy,
    parameters: Sequence[FreeParameter],
    current: np.ndarray,
    *,
    centre: bool = False,
    logs: int = 6,
    seed: int = 0,
    jobs: int = 1,
) -> MonteCarloCheck:
    """Simulate `logs` noisy logs of the nominal plant, estimate from each, and compare the errors with the prediction.

    The covariance assumes a run that is linear in parameters and noise. Where the rod almost breaks away or almost
    sticks, a change within the noise adds or removes an event, and estimates scatter more than any derivative shows.
    Parameters that are predicted to be undetermined keep their values. Estimates start at the truth.
    """
    plant, time = predicted.run.plant, predicted.run.time
    determined = [p for p in parameters if p.name not in predicted.undetermined]
    if not determined or logs < 1:
        return MonteCarloCheck(np.inf, 0, False)
    if len(determined) < len(parameters):
        predicted = predict_accuracy(predicted.run, determined)
    root, truth = np.linalg.cholesky(predicted.fit.information), predicted.fit.values

    def error(number: int) -> np.ndarray:
        """Errors (k,) of one estimate, in the predicted standard deviations of independent directions."""
        log, _ = record(plant, time, current, seed=1000 * (seed + 1) + number, centre=centre)
        log = replace(log, channels={name: log[name] for name in logged_channels(plant)})
        try:
            found = fit(plant, shooting_windows(plant, log, None), determined, steps=15)
        except EhsaError:
            return np.full(len(determined), np.inf)
        if isinstance(found, Diverged):
            return np.full(len(determined), np.inf)
        return np.asarray(root.T @ (found.values - truth))

    errors = np.zeros((0, len(determined)))
    with ThreadPoolExecutor(jobs) as pool:
        for numbers in (range(min(FIRST, logs)), range(FIRST, logs)):
            errors = np.vstack([errors, *pool.map(error, numbers)])
            squares = float(np.sum(errors**2))
            passed = squares <= float(stats.chi2.isf(RARE, errors.size))
            if not passed:
                break
    return MonteCarloCheck(float(np.sqrt(squares / errors.size)), len(errors), passed)
