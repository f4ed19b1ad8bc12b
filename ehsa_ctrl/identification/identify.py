"""Identify a plant from logs: a first estimate, windows, free run; uncertainty, validation."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ..core.errors import InputError
from ..core.log import Log, named
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant
from .balances import BalanceEstimate, estimate_by_balances, first_estimate
from .checks import check_log, refuse
from .estimator import Fit, Progress
from .free import FreeParameter, free_parameters, with_values
from .identification import Identification, Reach
from .replay import replay
from .starts import Search
from .uncertainty import Estimate, Uncertainty, balance_estimates, estimates, uncertainty
from .whiteness import Correlation, correlations
from .window import Window

#: Residuals of more than so many times the noise's variance, unless they are the weights, come from a run that misses
#: what happened: no standard deviation describes that.
DOUBTED = 3.0


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
    """Estimate a plant's parameters by the error of its simulation, eq. (13), each signal weighted by its noise.

    A plant whose file says so is estimated from its balances instead (inverse dynamics), with the estimate by
    simulation beside it where the simulation shows the parameters.

    Every log, or window of one, has an initial state of its own; the noise of the logged drive is part of the model
    (see `whitening`). A start is led through short windows first, then through the logs as a whole. It ends when two
    starts have come to the same minimum.

    Parameters
    ----------
    plant: start values, noise of the sensors, what is free.
    logs: one log or several of the same plant; see `read_plant_log`.
    validate: logs that are not used for the estimate; their free runs are scored.
    free, fix, bounds, priors: see `free_parameters`.
    method: "simulation" or "balances"; what the plant's file says by default.
    window: length of the windows of the last stage, s; by default each log as a whole, in free run from its first
        sample. The sample time gives one-step prediction.
    starts: at most so many starts: the balances' estimate, the plant's values, then draws around the best.
    seed: of these draws.
    watch: is told of every step.
    check: refuse logs that `check_log` finds wrong.

    Returns
    -------
    Identification. An interrupt (Ctrl-C) ends the search and keeps the best so far: `interrupted` says so.

    Raises
    ------
    InputError: a log that can't tell anything or is plainly wrong; names that are unknown; nothing to estimate.
    """
    began = time.monotonic()
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise InputError("identify needs at least one log")
    if window is not None and not window > 0.0:
        raise InputError(f"window = {window:g} s; expected more than 0")
    if starts < 1:
        raise InputError(f"starts = {starts}; expected 1 or more")
    every = named([*logs, *validate])
    logs, validate = every[: len(logs)], every[len(logs) :]
    parameters = free_parameters(plant, free=free, fix=fix, bounds=bounds, priors=priors)
    findings = [check_log(log, plant) for log in every]
    for log, found in zip(every, findings, strict=True):
        if check:
            refuse(log, found)
    chosen = method or plant.estimation.method
    balances = _balances(plant, logs, parameters)
    if chosen == "balances" and balances is None:
        raise InputError(
            f"{plant.name} has no balances for {', '.join(p.name for p in parameters)}; use its simulation"
        )
    search: Search | None = None
    without, interrupted = "", False
    shown = parameters if chosen == "simulation" else _shown(plant, parameters) if plant.estimation.beside else ()
    if shown:
        search = Search(plant, logs, shown, window, seed, watch)
        try:
            search.run(_first(plant, logs, parameters, balances), starts)
        except KeyboardInterrupt:
            if search.best is None and chosen == "simulation":
                raise
            interrupted = True
        except InputError as error:
            if chosen == "simulation":
                raise
            search, without = None, str(error)
    best = search.best if search is not None else None
    settled = search is None or search.settled
    primary, beside, certainty = _tables(plant, logs, parameters, chosen, search, balances)
    values = with_values(plant, [e.name for e in primary], [e.value for e in primary])
    identified = _with_provenance(values, primary, logs)
    whole = search is None or all(len(piece) == len(piece.log) for piece in search.long)
    return Identification(
        plant=identified,
        nominal=plant,
        method=chosen,
        estimates=primary,
        beside=beside,
        without=without,
        uncertainty=certainty,
        fit=best,
        balances=balances,
        tried=tuple(search.tried) if search is not None else (),
        settled=settled,
        train=_reach(identified, plant, logs),
        validation=_reach(identified, plant, validate),
        residual_tests=_residual_tests(best) if best is not None else (),
        findings=tuple(finding.of(log) for log, each in zip(every, findings, strict=True) for finding in each),
        window=None if whole or search is None else float(np.median(_lengths(search.long))),
        interrupted=interrupted,
        seconds=time.monotonic() - began,
        fell_back=search is not None and search.lost and search.long is search.short,
    )


def _reach(after: Plant, before: Plant, logs: Sequence[Log]) -> Reach:
    return Reach(tuple(replay(after, log) for log in logs), tuple(replay(before, log) for log in logs))


def _balances(plant: Plant, logs: Sequence[Log], parameters: Sequence[FreeParameter]) -> BalanceEstimate | None:
    """What the balances say, in the way that the plant's file asks for; None where there are none."""
    symbols = [parameter.name for parameter in parameters if parameter.sensor is None]
    if not plant.structure.system.balances or not symbols:
        return None
    how = plant.estimation
    return estimate_by_balances(
        plant, logs, symbols, method=how.balances, width=how.width, cutoff=how.cutoff, parallel=how.parallel
    )


def _first(
    plant: Plant, logs: Sequence[Log], parameters: Sequence[FreeParameter], balances: BalanceEstimate | None
) -> dict[str, float]:
    """Where the simulation's fit begins: the balances, in their weak form unless the plant's file has another."""
    if balances is not None and plant.estimation.method == "balances":
        return {name: found.value for name, found in balances.parameters.items()}
    return first_estimate(plant, logs, [parameter.name for parameter in parameters])


def _shown(plant: Plant, parameters: tuple[FreeParameter, ...]) -> tuple[FreeParameter, ...]:
    """Parameters that the simulation depends on: a rod that is moved from outside says nothing of its friction."""
    needed = needed_to_simulate(plant.structure.equations)
    return tuple(parameter for parameter in parameters if parameter.name in needed or parameter.sensor is not None)


def _tables(
    plant: Plant,
    logs: Sequence[Log],
    parameters: Sequence[FreeParameter],
    chosen: str,
    search: Search | None,
    balances: BalanceEstimate | None,
) -> tuple[tuple[Estimate, ...], tuple[Estimate, ...], Uncertainty]:
    """Estimates by the chosen method, those by the other one, and the uncertainty of the chosen."""
    by_fit: tuple[Estimate, ...] = ()
    best = search.best if search is not None else None
    if search is not None and best is not None:
        of_fit = uncertainty(best, search.spread)
        pairs = zip(best.parameters, best.values, strict=True)
        sizes = np.array([size_of(plant, p, float(value), logs) for p, value in pairs])
        by_fit = estimates(best, of_fit, sizes, sure=search.settled and (best.weighted or best.noise_ratio < DOUBTED))
    by_balance = balance_estimates(parameters, balances) if balances is not None else ()
    if chosen == "simulation":
        assert best is not None
        return by_fit, by_balance, of_fit
    sd = np.array([estimate.sd for estimate in by_balance])
    return by_balance, by_fit, Uncertainty(tuple(e.name for e in by_balance), np.diag(sd**2), "residuals")


def _lengths(windows: Sequence[Window]) -> list[float]:
    return [len(window) * window.log.sample_time for window in windows]


def size_of(plant: Plant, parameter: FreeParameter, value: float, logs: Sequence[Log]) -> float:
    """Against what a standard deviation is called small: the value, or what matters where zero is a fair value."""
    sensor = parameter.sensor
    if sensor is None:
        return abs(value)
    word, channel = sensor
    if word == "bias":
        return max(abs(value), 0.1 * float(np.std(logs[0][channel])) if channel in logs[0].channels else abs(value))
    return max(abs(value), logs[0].sample_time) if word in ("delay", "filter") else abs(value)


def _with_provenance(plant: Plant, table: Sequence[Estimate], logs: Sequence[Log]) -> Plant:
    """The same plant, its new numbers marked as identified."""
    files = ", ".join(log.name for log in logs if log.path is not None)
    note = f"identified from {files}" if files else "identified"
    changed = dict(plant.parameters)
    for estimate in table:
        if estimate.name in changed:
            changed[estimate.name] = replace(
                changed[estimate.name], source="identified", sd=estimate.sd, note=note, written=""
            )
    return replace(plant, parameters=changed)


def _residual_tests(best: Fit) -> tuple[Correlation, ...]:
    """Tests of the longest window's whitened residual against itself, the drive, the direction and the position."""
    run = max(best.point.runs, key=lambda run: len(run.window))
    white = run.whitening(run.residual[:, :, None], run.errors)[:, :, 0]
    plant = best.plant
    rows = slice(run.window.first, run.window.last + 1)
    system = plant.structure.system
    drive = system.drives[system.inputs[0]]
    against = {drive: run.window.log[drive][rows]}
    index = plant.structure.equations.index
    for state in plant.structure.equations.states:
        if state.name == "v":
            against["sign(v)"] = np.sign(run.states[:, index("v")])
        if state.name == "x":
            against["x"] = run.states[:, index("x")]
    return correlations(white, run.measurement.channels, against)
