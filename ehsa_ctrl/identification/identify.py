"""Identify a plant from logs: a first estimate, windows, free run; uncertainty, validation."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..plant.arrays import needs
from ..plant.plant import Plant
from .balances import BalanceEstimate, estimate_by_balances, first_estimate
from .checks import check_log
from .estimator import Fit, Point, Progress, fit
from .free import FreeParameter, free_parameters, with_values
from .identification import Identification, Reach
from .replay import replay
from .uncertainty import SPOTTED, Estimate, Uncertainty, balance_estimates, consistent, estimates, uncertainty
from .whiteness import Correlation, correlations
from .window import Window, cut, sensor_sd

#: Length of the windows in which a start finds its way [s]: some events of sticking, not many.
SHORT = 0.4
#: While it does, a parameter is held this loosely at where the start puts it, relative.
LOOSE = 0.3
#: Two starts that end within so much cost of each other, in squared standard deviations, have found the same minimum.
SAME = 10.0
#: After so many starts a best one is believed whose cost is within GOOD standard deviations of what noise makes it.
ENOUGH, GOOD = 3, 2.5
#: At most so many pieces are mended, each from NEAR samples before to NEAR after its middle.
MENDINGS, NEAR = 4, 20
#: Residuals of short windows beyond so many times the noise's variance are the model's own: no parameters make it fit.
#: Each channel is then weighed by the residual that it has, not by its noise, and drives are taken as logged.
MISFIT = 3.0
#: How often these weights are made anew.
REWEIGHTED = 4


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
    parameters = free_parameters(plant, free=free, fix=fix, bounds=bounds, priors=priors)
    findings = [check_log(log, plant) for log in [*logs, *validate]]
    for log, found in zip([*logs, *validate], findings, strict=True):
        errors = [finding for finding in found if finding.severity == "error"]
        if check and errors:
            where = "" if str(log.path) in errors[0].sentence else f"{log.path or 'the log'}: "
            raise InputError(where + errors[0].sentence)
    chosen = method or plant.estimation.method
    balances = _balances(plant, logs, parameters)
    if chosen == "balances" and balances is None:
        raise InputError(
            f"{plant.name} has no balances for {', '.join(p.name for p in parameters)}; use its simulation"
        )
    search: _Search | None = None
    without, interrupted = "", False
    shown = parameters if chosen == "simulation" else _shown(plant, parameters) if plant.estimation.beside else ()
    if shown:
        search = _Search(plant, logs, shown, window, seed, watch)
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
    primary, beside, certainty = _tables(plant, logs, parameters, chosen, best, balances)
    values = with_values(plant, [e.name for e in primary], [e.value for e in primary])
    identified = _with_provenance(values, primary, logs)
    whole = search is None or all(len(piece) == len(piece.log) for piece in search.long)
    return Identification(
        plant=identified,
        believed=plant,
        method=chosen,
        estimates=primary,
        beside=beside,
        without=without,
        uncertainty=certainty,
        fit=best,
        balances=balances,
        tried=tuple(search.tried) if search is not None else (),
        settled=search is None or search.settled or starts == 1,
        train=_reach(identified, plant, logs),
        validation=_reach(identified, plant, validate),
        residual_tests=_residual_tests(best) if best is not None else (),
        findings=tuple(finding for each in findings for finding in each),
        window=None if whole or search is None else float(np.median(_lengths(search.long))),
        interrupted=interrupted,
        seconds=time.monotonic() - began,
    )


def _reach(after: Plant, before: Plant, logs: Sequence[Log]) -> Reach:
    return Reach(tuple(replay(after, log) for log in logs), tuple(replay(before, log) for log in logs))


def _balances(plant: Plant, logs: Sequence[Log], parameters: Sequence[FreeParameter]) -> BalanceEstimate | None:
    """What the balances say, in the way that the plant's file asks for; None where there are none."""
    letters = [parameter.name for parameter in parameters if parameter.sensor is None]
    if not plant.structure.system.balances or not letters:
        return None
    how = plant.estimation
    return estimate_by_balances(
        plant, logs, letters, method=how.balances, width=how.width, cutoff=how.cutoff, parallel=how.parallel
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
    needed = set()
    for rate in plant.structure.equations.rates:
        needed |= needs(plant.structure.equations, rate)
    return tuple(parameter for parameter in parameters if parameter.name in needed or parameter.sensor is not None)


def _tables(
    plant: Plant,
    logs: Sequence[Log],
    parameters: Sequence[FreeParameter],
    chosen: str,
    best: Fit | None,
    balances: BalanceEstimate | None,
) -> tuple[tuple[Estimate, ...], tuple[Estimate, ...], Uncertainty]:
    """Estimates by the chosen method, those by the other one, and the uncertainty of the chosen."""
    by_fit: tuple[Estimate, ...] = ()
    if best is not None:
        of_fit = uncertainty(best)
        pairs = zip(best.parameters, best.values, strict=True)
        by_fit = estimates(best, of_fit, np.array([size_of(plant, p, float(value), logs) for p, value in pairs]))
    by_balance = balance_estimates(parameters, balances) if balances is not None else ()
    if chosen == "simulation":
        assert best is not None
        return by_fit, by_balance, of_fit
    sd = np.array([estimate.sd for estimate in by_balance])
    return by_balance, by_fit, Uncertainty(tuple(e.name for e in by_balance), np.diag(sd**2), "residuals")


class _Search:
    """Starts one after the other until two of them have come to the same best minimum.

    One that fits as well as noise allows is not enough: where the rod sticks and slips, minima that miss a slip here
    and there leave residuals that are hardly larger, with parameters that are ten deviations off.
    """

    def __init__(
        self,
        plant: Plant,
        logs: Sequence[Log],
        parameters: tuple[FreeParameter, ...],
        window: float | None,
        seed: int,
        watch: Callable[[Progress], None] | None,
    ) -> None:
        self.plant, self.parameters, self.watch = plant, parameters, watch
        self.short = [piece for log in logs for piece in cut(plant, log, SHORT)]
        self.long = [piece for log in logs for piece in cut(plant, log, window)]
        self.draws = np.random.default_rng(seed)
        self.best: Fit | None = None
        self.ends: list[float] = []
        self.settled = False
        self.misfit, self.best_size = False, np.inf
        self.tried: list[tuple[str, float]] = []

    def keep(self, found: Fit) -> None:
        """Remember the best so far, also in the middle of a stage."""
        if self.best is None or found.lowered <= self.best.lowered:
            self.best = found

    def run(self, first: Mapping[str, float], starts: int) -> None:
        plain = np.array([parameter.value for parameter in self.parameters])
        balanced = np.array([first.get(parameter.name, parameter.value) for parameter in self.parameters])
        candidates = [("balances", balanced)] if first else []
        candidates.append(("plant", plain))
        failures: list[InputError] = []
        for number in range(starts):
            if number < len(candidates):
                name, values = candidates[number]
            elif self.best is not None:
                name, values = f"draw {number - len(candidates) + 1}", self._draw(self.best)
            else:
                break
            try:
                self._one(name, values, through_windows=number < len(candidates))
            except InputError as error:
                failures.append(error)
                continue
            near = [cost for cost in self.ends if cost < min(self.ends) + SAME]
            good = number + 1 >= ENOUGH and self.best is not None and consistent(self.best, GOOD)
            if len(near) > 1 or good or (self.misfit and number + 1 >= len(candidates)):
                self.settled = True
                break
        if self.best is None:
            raise failures[0]
        self._polish()

    def _one(self, name: str, values: np.ndarray, *, through_windows: bool) -> None:
        """One start, through short windows unless it is near already, to the end."""
        if through_windows:
            held = [
                replace(parameter, value=float(value), prior_sd=parameter.prior_sd or LOOSE * abs(value) or None)
                for parameter, value in zip(self.parameters, np.clip(values, *self._bounds()), strict=True)
            ]
            near = fit(
                self.plant, self.short, held, stage=f"{name}, windows of {SHORT:g} s", steps=15, enough=1e-2,
                drive_errors=False, watch=self.watch,
            )  # fmt: skip
            values = near.values
            self.misfit = near.reduced_cost > MISFIT
        if self.misfit:
            self._weigh_by_residuals(name, values)
            return
        found = fit(
            self.plant, self.long, self.parameters, start=values, stage=name, steps=25, enough=1e-4,
            watch=self.watch, keep=self.keep,
        )  # fmt: skip
        self.tried.append((name, found.reduced_cost))
        self.ends.append(found.lowered)
        self.keep(found)

    def _weigh_by_residuals(self, name: str, values: np.ndarray) -> None:
        """Minimise the product of the channels' residuals: weights are the residuals of the round before.

        That is the maximum of the likelihood with a variance of its own for each channel, whatever it comes from.
        """
        weights: dict[str, float] | None = None
        for number in range(REWEIGHTED):
            if weights is None:
                weights = self._spreads()
            found = fit(
                self.plant, self.long, self.parameters, start=values, stage=f"{name}, weights {number + 1}", steps=12,
                enough=1e-3, drive_errors=False, weights=weights, watch=self.watch,
            )  # fmt: skip
            values, weights = found.values, _residual_rms(found)
            size = float(np.exp(np.mean(np.log(list(weights.values())))))
            if self.best is None or size < self.best_size:
                self.best, self.best_size = found, size
        self.tried.append((name, self.best_size))

    def _spreads(self) -> dict[str, float]:
        """Standard deviation of each channel itself, the weights to begin with."""
        channels = [c for c in self.plant.structure.system.outputs if c in self.long[0].log.channels]
        return {c: max(float(np.std(self.long[0].log[c])), 1e-300) for c in channels}

    def _polish(self) -> None:
        """Go on from the best to the very minimum."""
        best = self.best
        assert best is not None
        if self.misfit:
            return
        self._go_on(best.point, "best")
        self._mend()

    def _go_on(self, begin: Point, stage: str) -> None:
        """From a point to the minimum that it leads to; kept if it is lower."""
        self.keep(
            fit(self.plant, self.long, self.parameters, begin=begin, stage=stage, watch=self.watch, keep=self.keep)
        )

    def _mend(self) -> None:
        """Where one short piece fits plainly worse than noise, look for the slip that the simulation misses there.

        A rod that is held says nothing of what would break it away, so that no derivative leads there. Other errors of
        the drive just before may: none, or all a little higher or lower.
        """
        for attempt in range(MENDINGS):
            best = self.best
            assert best is not None
            size, run, at = best.worst_block
            if size < SPOTTED or best.point.runs[run].measurement.input_sd == 0.0:
                return
            sd = best.point.runs[run].measurement.input_sd
            before = best.lowered
            for push in (0.0, 1.5, -1.5, 3.0, -3.0):
                errors = [each.copy() for each in best.point.errors]
                errors[run][max(at - NEAR, 0) : at + NEAR] = push * sd
                self._go_on(replace(best.point, errors=tuple(errors), runs=()), f"mending {attempt + 1}")
                if self.best is not None and self.best.lowered < before - SAME:
                    break
            else:
                return

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([p.lower for p in self.parameters]), np.array([p.upper for p in self.parameters])

    def _draw(self, best: Fit) -> np.ndarray:
        """Values around the best so far, wide where the log says little."""
        sd = uncertainty(best).sd
        size = np.maximum(np.abs(best.values), 1e-300)
        spread = np.clip(30.0 * np.where(np.isfinite(sd), sd, size) / size, 0.03, LOOSE)
        drawn = best.values * np.exp(spread * self.draws.standard_normal(size.size))
        return np.clip(drawn, *self._bounds())


def _residual_rms(found: Fit) -> dict[str, float]:
    """RMS of each channel's residual, in its own unit, but not less than its noise."""
    rms = {}
    for c, channel in enumerate(found.point.runs[0].measurement.channels):
        residual = np.concatenate([run.residual[:, c] for run in found.point.runs])
        noise = sensor_sd(found.plant, found.point.runs[0].window.log, channel)
        rms[channel] = max(float(np.sqrt(np.mean(residual**2))), noise)
    return rms


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
    return max(abs(value), logs[0].sample_time) if word == "delay" else abs(value)


def _with_provenance(plant: Plant, table: Sequence[Estimate], logs: Sequence[Log]) -> Plant:
    """The same plant, its new numbers marked as identified."""
    files = ", ".join(log.path.name for log in logs if log.path is not None)
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
