"""Identify a plant from logs: checks, balances, multi-start simulation fit, uncertainty, validation."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ..core.errors import InputError
from ..core.log import Log, named
from ..core.parallel import one_blas_thread
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant
from .balances import BalanceEstimate, estimate_by_balances, first_estimate
from .checks import check_log, raise_on_error
from .comparison import replay
from .fit_result import Diverged, Fit, Progress
from .identification import FreeRuns, Identification
from .innovations import whiten
from .multi_start import SearchResult, multi_start
from .parameters import FreeParameter, free_parameters, with_values
from .residual_tests import Correlation, correlations
from .uncertainty import Estimate, ParameterCovariance, balance_estimates, estimates, parameter_covariance

Method = Literal["simulation", "balances"]

#: Residuals above this multiple of the noise's variance mean that the run misses events of the log, which no standard
#: deviation describes; unless they are the weights. Engineering judgement.
MAX_NOISE_RATIO = 3.0


@one_blas_thread()
def identify(
    plant: Plant,
    logs: Log | Sequence[Log],
    *,
    validate: Sequence[Log] = (),
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, float | None] | None = None,
    method: Literal["simulation", "balances"] | None = None,
    window: float | None = None,
    starts: int = 6,
    seed: int = 0,
    watch: Callable[[Progress], None] | None = None,
    check: bool = True,
) -> Identification:
    """Estimate a plant's parameters by minimising the simulation error, eq. (13), each signal weighted by its noise.

    If the plant's file says so, they are estimated from its balances instead (inverse dynamics), with the estimate by
    simulation for comparison where the simulation depends on the parameters.

    Every log, or window of one, has its own initial state. The noise of the logged input is part of the model (see
    `innovations`). A start is first fitted over short windows, then over the whole logs. The search ends when two
    starts have reached the same minimum.

    Parameters
    ----------
    plant: gives start values, noise of the sensors, and the free parameters.
    logs: one log or several of the same plant; see `read_plant_log`. `settings` of a log hold for it alone.
    validate: logs that are not used for the estimate; their free runs are scored.
    free, fix, bounds, priors: see `free_parameters`.
    method: "simulation" or "balances"; by default that of the plant's file.
    window: length of the windows of the last stage, s; by default each log as a whole, in free run from its first
        sample. The sample time gives one-step prediction.
    starts: largest number of starts: the balances' estimate, the plant's values, then random ones around the best.
    seed: of these random starts.
    watch: progress callback, called after every step.
    check: reject logs in which `check_log` finds an error.

    Returns
    -------
    Identification. Ctrl-C ends the search and keeps the best result so far: `interrupted` is then True.

    Raises
    ------
    InputError: a log without information or with an error; unknown names; nothing to estimate; a plant that can't be
        simulated along the logs from any start.
    """
    began = time.monotonic()
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise InputError("identify needs at least one log")
    if window is not None and not window > 0.0:
        raise InputError(f"window = {window:g} s; expected more than 0")
    if starts < 1:
        raise InputError(f"starts = {starts}; expected 1 or more")
    all_logs = named([*logs, *validate])
    logs, validate = all_logs[: len(logs)], all_logs[len(logs) :]
    parameters = free_parameters(plant, free=free, fix=fix, bounds=bounds, priors=priors)
    for log in all_logs:
        if estimated := [one.name for one in parameters if one.name in log.settings]:
            raise InputError(f"{log.name}: sets {estimated[0]}, which is to be estimated; leave it out of one of them")
    findings = [(log, check_log(log, plant)) for log in all_logs]
    if check:
        for log, found in findings:
            raise_on_error(log, found)

    chosen = method or plant.estimation.method
    balances = _balances(plant, logs, parameters)
    if chosen == "balances" and balances is None:
        raise InputError(
            f'{plant.name} has no balances for {", ".join(p.name for p in parameters)}; use method = "simulation"'
        )
    search, no_simulation, interrupted = None, "", False
    if simulated := _simulated_parameters(plant, parameters, chosen):
        first = _first_values(plant, logs, parameters, balances)
        try:
            found_minimum = multi_start(
                plant, logs, simulated, first, window=window, starts=starts, seed=seed, watch=watch
            )
            if isinstance(found_minimum, Diverged):
                raise InputError(str(found_minimum))
            search = found_minimum
        except (InputError, KeyboardInterrupt) as error:
            if chosen == "simulation":
                raise
            interrupted = isinstance(error, KeyboardInterrupt)
            no_simulation = "interrupted" if interrupted else str(error)

    by_simulation, covariance = _simulation_estimates(search, logs)
    by_balances = balance_estimates(parameters, balances) if balances is not None else ()
    primary, other = (by_simulation, by_balances) if chosen == "simulation" else (by_balances, by_simulation)
    if chosen == "balances" or covariance is None:
        sd = np.array([estimate.sd for estimate in primary])
        covariance = ParameterCovariance(tuple(e.name for e in primary), np.diag(sd**2), "residuals")

    identified = _identified_plant(plant, primary, logs)
    return Identification(
        plant=identified,
        nominal=plant,
        method=chosen,
        estimates=primary,
        other_estimates=other,
        no_simulation=no_simulation,
        uncertainty=covariance,
        fit=None if search is None else search.best,
        balances=balances,
        starts=() if search is None else search.starts,
        starts_agree=search is None or search.agree,
        disagreement=None if search is None else search.disagreement,
        train=_free_runs(identified, plant, logs),
        validation=_free_runs(identified, plant, validate),
        residual_tests=() if search is None else _residual_tests(search.best),
        findings=tuple(finding.labelled(log) for log, found in findings for finding in found),
        window=None if search is None else _window_length(search),
        interrupted=interrupted or (search is not None and search.interrupted),
        seconds=time.monotonic() - began,
        fell_back=search is not None and search.fell_back,
    )


def _balances(plant: Plant, logs: Sequence[Log], parameters: Sequence[FreeParameter]) -> BalanceEstimate | None:
    """The estimate from balances with the settings of the plant's file; None for a system without balances."""
    symbols = [parameter.name for parameter in parameters if parameter.sensor is None]
    if not plant.structure.system.balances or not symbols:
        return None
    how = plant.estimation
    return estimate_by_balances(
        plant, logs, symbols, method=how.balances, width=how.width, cutoff=how.cutoff, parallel=how.parallel
    )


def _simulated_parameters(
    plant: Plant, parameters: tuple[FreeParameter, ...], method: Method
) -> tuple[FreeParameter, ...]:
    """Parameters to fit by simulation: with the method "balances" only those on which the simulation depends.

    A rod with prescribed motion, for example, does not show its friction in a simulation.
    """
    if method == "simulation":
        return parameters
    if not plant.estimation.beside:
        return ()
    needed = needed_to_simulate(plant.structure.equations)
    return tuple(parameter for parameter in parameters if parameter.name in needed or parameter.sensor is not None)


def _first_values(
    plant: Plant, logs: Sequence[Log], parameters: Sequence[FreeParameter], balances: BalanceEstimate | None
) -> dict[str, float]:
    """Start values of the simulation fit from the balances, in weak form unless they are the plant's own method."""
    if balances is not None and plant.estimation.method == "balances":
        return {name: found.value for name, found in balances.parameters.items()}
    return first_estimate(plant, logs, [parameter.name for parameter in parameters])


def _simulation_estimates(
    search: SearchResult | None, logs: Sequence[Log]
) -> tuple[tuple[Estimate, ...], ParameterCovariance | None]:
    """Estimates of the simulation fit with their covariance."""
    if search is None:
        return (), None
    best = search.best
    covariance = parameter_covariance(best, search.spread)
    pairs = zip(best.parameters, best.values, strict=True)
    sizes = np.array([parameter.reference_size(float(value), logs) for parameter, value in pairs])
    sure = search.agree and (best.weighted or best.noise_ratio < MAX_NOISE_RATIO)
    return estimates(best, covariance, sizes, sure=sure), covariance


def _identified_plant(plant: Plant, table: Sequence[Estimate], logs: Sequence[Log]) -> Plant:
    """The plant with the estimated values, marked as identified."""
    files = ", ".join(log.name for log in logs if log.path is not None)
    note = f"identified from {files}" if files else "identified"
    plant = with_values(plant, [e.name for e in table], [e.value for e in table])
    changed = dict(plant.parameters)
    for e in table:
        if e.name in changed:
            changed[e.name] = replace(changed[e.name], source="identified", sd=e.sd, note=note, written="")
    return replace(plant, parameters=changed)


def _free_runs(after: Plant, before: Plant, logs: Sequence[Log]) -> FreeRuns:
    return FreeRuns(tuple(replay(after, log) for log in logs), tuple(replay(before, log) for log in logs))


def _window_length(search: SearchResult) -> float | None:
    """Median length of the windows [s]; None if each is a whole log."""
    if all(len(window) == len(window.log) for window in search.windows):
        return None
    return float(np.median([len(window) * window.log.sample_time for window in search.windows]))


def _residual_tests(best: Fit) -> tuple[Correlation, ...]:
    """Tests of the longest window's whitened residual against itself, the input, the direction and the position."""
    run = max(best.iterate.runs, key=lambda run: len(run.window))
    white = whiten(run.whitening, run.residual[:, :, None], run.errors)[:, :, 0]
    system, equations = best.plant.structure.system, best.plant.structure.equations
    drive = system.drives[system.inputs[0]]
    against = {drive: run.window.log[drive][run.window.first : run.window.last + 1]}
    for speed, position in system.slopes.items():
        against[f"sign({speed})"] = np.sign(run.states[:, equations.index(speed)])
        against[position] = run.states[:, equations.index(position)]
    return correlations(white, run.measured.channels, against)
