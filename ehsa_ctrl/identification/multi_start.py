"""Multi-start search for the minimum of the cost: short windows first, then the logs, until two starts agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.log import Log
from ..plant.plant import Plant
from .fit_result import Diverged, Fit, Iterate, Progress
from .gauss_newton import ENOUGH_COST, INTERRUPTED, fit
from .initial_state import sensor_sd
from .parameters import FreeParameter, bounds_of
from .shooting import ShootingWindow, shooting_windows
from .uncertainty import SLIP_DEVIATIONS, parameter_covariance, within_noise
from .window_stage import LOOSE, MISFIT, SHORT, WindowOptimum, WindowStage

# Costs are sums of squares in standard deviations of the noise. The numbers are engineering judgement.

#: Two optima whose costs differ by less than this are the same minimum.
SAME_COST = 10.0
#: Optima whose costs differ by more than this (ten standard deviations, squared) differ by several slips of the rod.
DIFFERENT_COST = 100.0
#: Optima agree if all parameters are within this many standard deviations of the best; minimum number of agreeing
#: optima if no two have the same cost.
EQUAL_DEVIATIONS, MIN_OPTIMA = 3.0, 3
#: Residuals within this many standard deviations of the noise's size are acceptable as noise.
ACCEPTABLE = 3.0
#: If no two starts agree: number of further starts around the best optimum, and their spread in standard deviations.
NEAR_DRAWS, NEAR_DEVIATIONS = 4, 12.0
#: Spread of random starts around the best optimum otherwise, in standard deviations.
FAR_DEVIATIONS = 30.0
#: Largest number of missed slips to repair, and the samples on either side in which input errors are changed.
REPAIRS, REPAIR_SAMPLES = 4, 20
#: Input errors that are tried there, in standard deviations.
REPAIR_ERRORS = (0.0, 1.5, -1.5, 3.0, -3.0)
#: Above this multiple of the noise's variance no start fits the logs in free run; short windows may fit.
NOT_FOLLOWED = 1.5
#: Number of window-stage results from which the fallback to short windows starts.
FALLBACK_STARTS = 3
#: Two fits weighted by residuals agree if the residuals' sizes differ by less than this, relative.
SAME_SIZE = 0.01
#: Number of reweighting iterations.
REWEIGHTINGS = 4


@dataclass(frozen=True)
class SearchResult:
    """The outcome of a multi-start search.

    best: lowest minimum. windows: those of its cost. starts: (name, noise ratio or residual size) of each start.
    agree: two starts reached the same minimum, or all that fit within the noise have the same parameters. disagreement:
    noise ratios of the two lowest of the latter if their costs are far apart, else None. spread (k, k): mean square
    distance of acceptable other optima from the best, zero if two have the same cost. fell_back: short windows were
    fitted, because no start fitted the whole logs.
    """

    best: Fit
    windows: tuple[ShootingWindow, ...]
    starts: tuple[tuple[str, float], ...]
    agree: bool
    disagreement: tuple[float, float] | None
    spread: np.ndarray
    fell_back: bool
    interrupted: bool


def multi_start(
    plant: Plant,
    logs: Sequence[Log],
    parameters: tuple[FreeParameter, ...],
    first: Mapping[str, float],
    *,
    window: float | None = None,
    starts: int = 6,
    seed: int = 0,
    watch: Callable[[Progress], None] | None = None,
) -> SearchResult | Diverged:
    """Fit from several starts until two of them reach the same lowest minimum.

    One start whose residuals are noise is not enough: with stick-slip, a local minimum that misses single slips has
    residuals hardly larger than noise, but parameters that may be ten standard deviations off.

    Parameters
    ----------
    first: estimates from the balances, by name; with the plant's own values they are the first two starts.
    window: length of the windows of the cost, s; None: each log in free run.
    starts: largest number of starts; seed: of the random ones.
    watch: progress callback, called after each step of a fit.

    Returns
    -------
    SearchResult, or Diverged if the plant can't be simulated along the logs from any start. Ctrl-C before the first
    complete step of the last stage raises KeyboardInterrupt; later it ends the search with the best result so far.
    """
    search = _Search(plant, logs, parameters, window, seed, watch)
    interrupted = False
    try:
        failed = search.run(first, starts)
    except KeyboardInterrupt:
        if search.best is None:
            raise
        failed, interrupted = None, True
    if failed is not None:
        return failed
    return SearchResult(
        search.lowest, tuple(search.windows), tuple(search.starts), search.agree, search.disagreement(),
        search.spread(), search.fell_back, interrupted,
    )  # fmt: skip


class _Search:
    """State of one search: optima of the starts so far and the best of them."""

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
        self.short = [piece for log in logs for piece in shooting_windows(plant, log, SHORT)]
        self.windows = [piece for log in logs for piece in shooting_windows(plant, log, window)]
        self.random = np.random.default_rng(seed)
        self.bounds = bounds_of(parameters)
        self.best: Fit | None = None
        self.best_size = np.inf
        self.optima: list[Fit] = []
        self.starts: list[tuple[str, float]] = []
        self.agree = self.fell_back = False

    @property
    def lowest(self) -> Fit:
        assert self.best is not None, "a start has converged"
        return self.best

    def run(self, first: Mapping[str, float], starts: int) -> Diverged | None:
        """All stages; Diverged if no start could be simulated."""
        nominal = np.array([parameter.value for parameter in self.parameters])
        balances = np.array([first.get(parameter.name, parameter.value) for parameter in self.parameters])
        candidates = {"balances": balances, "plant": nominal} if first else {"plant": nominal}
        optima = WindowStage(self.plant, self.parameters, self.short, self.watch).run(candidates, self.random)
        if isinstance(optima, Diverged):
            return optima
        # If no start fits, the model is wrong; if only some don't, these starts are bad.
        fitting = [optimum for optimum in optima if optimum.cost <= MISFIT]
        if not fitting:
            return self._weight_by_residuals(optima, min(starts, 2))
        diverged: Diverged | None = None
        lost = False
        ordered = min(len(fitting), 2)
        for number in range(starts):
            # The two best of the window stage; more would mostly lead to the same minimum.
            name, values = f"draw {number - ordered + 1}", fitting[0].values
            if number < ordered:
                name, values = fitting[number].name, fitting[number].values
            else:
                values = self._draw(values)
            failed = self._fit_from(name, values)
            if failed is not None:
                diverged = failed
                continue
            lost = number + 1 >= ordered and self.lowest.noise_ratio > MISFIT
            if lost or (within_noise(self.lowest) and self._count_agreeing_optima() > 1):
                break
        if self.best is None:
            return diverged
        self.agree = self._count_agreeing_optima() > 1
        if not self.agree and not lost and within_noise(self.best):
            self._search_near_best()
        if not lost:
            self._fit_log("best", begin=self.best.iterate)
            self._repair_missed_slips()
        if self.best.noise_ratio > NOT_FOLLOWED:
            self._fall_back([optimum.values for optimum in fitting[:FALLBACK_STARTS]], lost)
        return None

    # The logs as they are

    def _fit_log(
        self,
        stage: str,
        *,
        start: np.ndarray | None = None,
        begin: Iterate | None = None,
        steps: int = 40,
        enough: float = ENOUGH_COST,
    ) -> Fit | Diverged:
        """Fit over the windows of the cost and keep the result if it is the lowest; also when interrupted."""
        found = fit(
            self.plant, self.windows, self.parameters, start=start, begin=begin, steps=steps, enough=enough,
            stage=stage, watch=self.watch, interruptible=True,
        )  # fmt: skip
        if not isinstance(found, Diverged):
            if self.best is None or found.objective <= self.best.objective:
                self.best = found
            if found.stopped == INTERRUPTED:
                raise KeyboardInterrupt
        return found

    def _fit_from(self, name: str, values: np.ndarray) -> Diverged | None:
        """Fit the logs from one start."""
        found = self._fit_log(name, start=values, steps=25, enough=1e-4)
        if isinstance(found, Diverged):
            return found
        self.starts.append((name, found.noise_ratio))
        self.optima.append(found)
        return None

    def _search_near_best(self) -> None:
        """Starts around the best optimum, which no other start reached: do they lead back to it, or to a lower one?"""
        for number in range(NEAR_DRAWS):
            values = self._draw(self.lowest.values, NEAR_DEVIATIONS)
            if self._fit_from(f"near {number + 1}", values) is None and self._count_agreeing_optima() > 1:
                self.agree = True
                return

    def _repair_missed_slips(self) -> None:
        """If a short piece fits clearly worse than noise, search for a slip of the rod that the simulation misses.

        The derivatives of a sticking rod are zero and do not show what would break it away. Therefore the fit is
        repeated with other input errors just before that piece.
        """
        for attempt in range(REPAIRS):
            best = self.lowest
            size, run, at = best.worst_block
            sd = best.iterate.runs[run].measured.input_sd
            if size < SLIP_DEVIATIONS or sd == 0.0:
                return
            for error in REPAIR_ERRORS:
                errors = [each.copy() for each in best.iterate.errors]
                errors[run][max(at - REPAIR_SAMPLES, 0) : at + REPAIR_SAMPLES] = error * sd
                self._fit_log(f"repair {attempt + 1}", begin=replace(best.iterate, errors=tuple(errors), runs=()))
                if self.lowest.objective < best.objective - SAME_COST:
                    break
            else:
                return

    def _draw(self, near: np.ndarray, deviations: float = FAR_DEVIATIONS) -> np.ndarray:
        """Random values around the best optimum, or around `near` if none fits yet."""
        if self.best is None or self.best.noise_ratio > MISFIT:
            values, spread = near, np.full(near.size, LOOSE / 3.0)
        else:
            values, sd = self.best.values, parameter_covariance(self.best).sd
            size = np.maximum(np.abs(values), 1e-300)
            spread = np.clip(deviations * np.where(np.isfinite(sd), sd, size) / size, 1e-3 * deviations, LOOSE)
        return np.clip(values * np.exp(spread * self.random.standard_normal(values.size)), *self.bounds)

    # Agreement of optima

    def _count_agreeing_optima(self) -> int:
        """Number of optima in the same minimum as the lowest one.

        With stick-slip a minimum splits into many that differ by a slip. Then it is enough, after MIN_OPTIMA starts,
        that all acceptable optima have the same parameters; optima that fit worse are not candidates.
        """
        low, acceptable = self._count_lowest_optima(), self._acceptable_optima()
        if low > 1 or len(self.optima) < MIN_OPTIMA or not acceptable:
            return low
        sd = parameter_covariance(self.lowest).sd
        known = np.isfinite(sd) & (sd > 0.0)
        limit, best = EQUAL_DEVIATIONS * sd[known], self.lowest.values
        same = all(np.all(np.abs(optimum.values - best)[known] <= limit) for optimum in acceptable)
        return len(self.optima) if same else low

    def _acceptable_optima(self) -> list[Fit]:
        """Ends whose residuals could be noise."""
        return [optimum for optimum in self.optima if within_noise(optimum, ACCEPTABLE)]

    def _count_lowest_optima(self) -> int:
        """Number of optima with the cost of the lowest one."""
        lowest = min(optimum.objective for optimum in self.optima)
        return sum(optimum.objective < lowest + SAME_COST for optimum in self.optima)

    def disagreement(self) -> tuple[float, float] | None:
        """Noise ratios of the two lowest acceptable optima, if they agree in the parameters while their costs are far
        apart; else None."""
        optima = sorted(self._acceptable_optima(), key=lambda optimum: optimum.objective)[:2]
        if not self.agree or len(optima) < 2 or optima[1].objective - optima[0].objective < DIFFERENT_COST:
            return None
        return optima[0].noise_ratio, optima[1].noise_ratio

    def spread(self) -> np.ndarray:
        """Mean square distance (k, k) of other plausible optima from the best, where no two have the same cost."""
        best = self.lowest
        level = NOT_FOLLOWED * max(best.noise_ratio, 1.0)
        others = self._acceptable_optima() if self.agree else [o for o in self.optima if o.noise_ratio < level]
        away = [optimum.values - best.values for optimum in others if np.any(optimum.values != best.values)]
        if not away or self._count_lowest_optima() > 1:
            return np.zeros((best.values.size, best.values.size))
        return np.asarray(np.mean([np.outer(step, step) for step in away], axis=0))

    # Models that do not fit, and logs that no start fits in free run

    def _weight_by_residuals(self, optima: Sequence[WindowOptimum], starts: int) -> Diverged | None:
        """Minimise the product of the channels' residual variances, from the first starts that can be simulated.

        The weights are the residuals of the iteration before: maximum likelihood with an unknown variance for each
        channel, whatever its cause.
        """
        channels = [c for c in self.plant.structure.system.outputs if c in self.windows[0].log.channels]
        signals = {c: max(float(np.std(self.windows[0].log[c])), 1e-300) for c in channels}
        diverged: Diverged | None = None
        for _, name, values in optima:
            if len(self.starts) == starts:
                break
            weights = signals
            for number in range(REWEIGHTINGS):
                found = fit(
                    self.plant, self.windows, self.parameters, start=values, stage=f"{name}, weights {number + 1}",
                    steps=12, enough=1e-3, drive_errors=False, weights=weights, watch=self.watch,
                )  # fmt: skip
                if isinstance(found, Diverged):
                    diverged = found
                    break
                values, weights = found.values, _residual_rms(found)
                size = float(np.exp(np.mean(np.log(list(weights.values())))))
                if self.best is None or size < self.best_size:
                    self.best, self.best_size = found, size
            else:
                self.starts.append((name, self.best_size))
        sizes = sorted(size for _, size in self.starts)
        self.agree = len(sizes) == 1 or (len(sizes) > 1 and sizes[1] < (1.0 + SAME_SIZE) * sizes[0])
        return diverged if self.best is None else None

    def _fall_back(self, candidates: Sequence[np.ndarray], lost: bool) -> None:
        """Fit short windows, because no start fitted the whole logs; the result is kept if it fits better."""
        optima = []
        for number, values in enumerate(candidates):
            stage = f"windows of {SHORT:g} s, {number + 1}"
            found = fit(
                self.plant, self.short, self.parameters, start=values, stage=stage, enough=1e-4, watch=self.watch
            )
            if not isinstance(found, Diverged):
                self.starts.append((stage, found.noise_ratio))
                optima.append(found)
        best = min(optima, key=lambda optimum: optimum.objective, default=self.lowest)
        if best.noise_ratio < self.lowest.noise_ratio:
            self.best, self.windows, self.optima, self.fell_back = best, self.short, optima, lost
            self.agree = self._count_agreeing_optima() > 1


def _residual_rms(found: Fit) -> dict[str, float]:
    """RMS of each channel's residual, in its own unit, but not less than its noise."""
    rms = {}
    for c, channel in enumerate(found.iterate.runs[0].measured.channels):
        residual = np.concatenate([run.residual[:, c] for run in found.iterate.runs])
        noise = sensor_sd(found.plant, found.iterate.runs[0].window.log, channel)
        rms[channel] = max(float(np.sqrt(np.mean(residual**2))), noise)
    return rms
