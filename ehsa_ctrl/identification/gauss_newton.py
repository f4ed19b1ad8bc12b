"""Damped Gauss-Newton on whitened simulation errors, with the windows' initial states eliminated exactly.

The initial state of a window affects only that window's residuals, so that an orthogonal decomposition per window
leaves a small problem in the parameters (variable projection; G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2),
1973; here the problem is linear to first order, as the whole step is). `scipy.optimize.lsq_linear` solves it within
the bounds; damping grows until a step lowers the true cost.

There are two costs. Without errors of the logged input as unknowns, the innovations filter of a run accounts for them;
it depends on the parameters through the run, and is held fixed within a step and computed anew afterwards (iteratively
reweighted least squares). With input errors as unknowns, the cost is the sum of squares of all noise: of the sensors
and of the logged input. To first order both have their minimum at the same parameters. Where friction holds the rod
until the input exceeds a threshold, first order is not enough: a simulation with the noisy log breaks away at the first
peak of its noise, and the second cost is the right one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ..core.errors import InputError, SimulationError
from ..plant.plant import Plant
from .fit_result import Diverged, Fit, Iterate, Progress
from .innovations import smooth_input_errors, whiten
from .parameters import FreeParameter, bounds_of, with_values
from .residuals import WindowRun, simulate_window
from .shooting import ShootingWindow

#: Convergence: a step gains less than this share of the cost, or moves each parameter by less than this share of its
#: standard deviation.
ENOUGH_COST, ENOUGH_STEP = 1e-6, 1e-2
#: Length of a block of scores [s]: longer than the correlation of a wrong model's residuals, mostly.
SCORE_TIME = 0.5
#: `Fit.stopped` after Ctrl-C.
INTERRUPTED = "interrupted"


def fit(
    plant: Plant,
    windows: Sequence[ShootingWindow],
    parameters: Sequence[FreeParameter],
    *,
    start: np.ndarray | None = None,
    begin: Iterate | None = None,
    drive_errors: bool = True,
    weights: Mapping[str, float] | None = None,
    steps: int = 40,
    stage: str = "",
    watch: Callable[[Progress], None] | None = None,
    interruptible: bool = False,
    tolerance: float = 1e-6,
    enough: float = ENOUGH_COST,
) -> Fit | Diverged:
    """Minimise the whitened simulation error over windows.

    Parameters
    ----------
    start: (k,) initial parameter values; the plant's by default. begin: continue from here instead, with its initial
        states and input errors.
    drive_errors: estimate the errors of the logged input as unknowns (the second cost above).
    weights: channel -> standard deviation, instead of the noise of sensors and input.
    steps: largest number of accepted steps.
    watch: is called after each step, labelled with `stage`.
    interruptible: Ctrl-C returns the result so far, with `stopped` = INTERRUPTED.
    enough: relative decrease of the cost below which the iteration ends.

    Returns
    -------
    Fit, or Diverged if the plant can't be simulated over the windows at the initial values.
    """
    problem = _Problem(plant, tuple(windows), tuple(parameters), drive_errors, weights, tolerance)
    if begin is None:
        values = np.array([p.value for p in parameters]) if start is None else np.array(start, dtype=float)
        starts = tuple(window.start for window in windows)
        begin = Iterate(values, starts, tuple(np.zeros(len(window)) for window in windows), ())
    values = np.clip(begin.values, problem.lower, problem.upper)
    first = problem.simulate(values, begin.starts, begin.errors)
    here = problem.linearise(first) if first is not None else None
    if here is None:
        return Diverged(plant.name, problem.names, values)
    damping, done, stopped = 1e-3, 0, "no steps were left"
    try:
        while done < steps:
            accepted = problem.improve(here, damping)
            if accepted is None:
                stopped = "no step lowers the cost any more"
                break
            there, damping, gain = accepted
            moved = np.abs(there.iterate.values - here.iterate.values) * np.sqrt(np.diag(here.information))
            here, done = there, done + 1
            if watch is not None:
                cost = here.white_cost / here.residuals
                watch(Progress(stage, done, cost, problem.names, here.iterate.values))
            if gain < enough or (moved.size and np.max(moved) < ENOUGH_STEP and damping <= 1e-2):
                stopped = "converged"
                break
    except KeyboardInterrupt:
        if not interruptible or not done:
            raise
        stopped = INTERRUPTED
    return Fit(
        parameters=problem.parameters,
        plant=with_values(plant, problem.names, here.iterate.values),
        iterate=here.iterate,
        cost=here.white_cost,
        objective=here.cost,
        weighted=weights is not None,
        residuals=here.residuals,
        information=here.information,
        scores=here.scores,
        steps=done,
        stopped=stopped,
    )


@dataclass(frozen=True)
class _Elimination:
    """QR elimination of one window's initial state: upper triangle, Q^T J, Q^T r, and the whitened columns."""

    upper: np.ndarray
    by_parameter: np.ndarray
    residual: np.ndarray
    white: np.ndarray


@dataclass(frozen=True)
class _Linearised:
    """The problem linearised at an iterate: R (k, k) and right side (k,) after elimination of the initial states.

    cost: what a step has to lower. white_cost: sum of squares of the whitened residuals and priors.
    """

    iterate: Iterate
    cost: float
    white_cost: float
    R: np.ndarray
    right: np.ndarray
    information: np.ndarray
    scores: np.ndarray
    eliminated: tuple[_Elimination, ...]

    @property
    def residuals(self) -> int:
        return sum(run.residual.size for run in self.iterate.runs)


class _Problem:
    """The least-squares problem: plant, windows, parameters with bounds and priors, and the choice of the cost."""

    def __init__(
        self,
        plant: Plant,
        windows: tuple[ShootingWindow, ...],
        parameters: tuple[FreeParameter, ...],
        drive_errors: bool,
        weights: Mapping[str, float] | None,
        tolerance: float,
    ) -> None:
        self.plant, self.windows, self.parameters = plant, windows, parameters
        self.drive_errors, self.weights, self.tolerance = drive_errors, weights, tolerance
        self.names = tuple(parameter.name for parameter in parameters)
        self.lower, self.upper = bounds_of(parameters)
        self.prior = np.array([parameter.value for parameter in parameters])
        self.prior_weight = np.array([1.0 / p.prior_sd if p.prior_sd else 0.0 for p in parameters])

    def simulate(
        self, values: np.ndarray, starts: Sequence[np.ndarray], errors: Sequence[np.ndarray]
    ) -> Iterate | None:
        """Simulate all windows; None if one of them diverges, or for values that the plant can't have."""
        try:
            plant = with_values(self.plant, self.names, values)
        except InputError:
            return None

        def one(window: ShootingWindow, start: np.ndarray, error: np.ndarray) -> WindowRun:
            return simulate_window(
                plant, window, start, self.names, errors=error, weights=self.weights, tolerance=self.tolerance
            )

        try:
            if len(self.windows) == 1:
                runs = [one(self.windows[0], starts[0], errors[0])]
            else:
                with ThreadPoolExecutor(2) as pool:
                    runs = list(pool.map(one, self.windows, starts, errors))
        except (SimulationError, FloatingPointError):
            return None
        if not all(np.isfinite(run.residual).all() and np.abs(run.by_parameter).max() < 1e30 for run in runs):
            return None
        return Iterate(values, tuple(starts), tuple(errors), tuple(runs))

    def improve(self, here: _Linearised, damping: float) -> tuple[_Linearised, float, float] | None:
        """Increase the damping until a step lowers the cost: the new point, damping and relative gain; None: none."""
        for _ in range(8):
            trial, promised = self.step(here, damping)
            if trial is not None:
                cost = self.cost(trial, here.iterate)
                there = self.linearise(trial) if cost < here.cost else None
                if there is not None:
                    ratio = (here.cost - cost) / max(promised, 1e-300)
                    damping = max(damping * (0.1 if ratio > 0.7 else 0.5 if ratio > 0.3 else 2.0), 1e-9)
                    return there, damping, (here.cost - cost) / max(here.cost, 1e-300)
            if promised < 1e-9 * here.cost:
                return None
            damping = max(damping * 8.0, 1e-6)
        return None

    def cost(self, trial: Iterate, base: Iterate) -> float:
        """The minimised cost of a trial; without input errors, by the innovations filter of the iterate before it."""
        total = float(np.sum(((trial.values - self.prior) * self.prior_weight) ** 2))
        for run, old, start in zip(trial.runs, base.runs, trial.starts, strict=True):
            total += float(np.sum(_start_residual(run.window, start) ** 2))
            if self.drive_errors:
                total += _noise_cost(run)
            else:
                total += float(np.sum(whiten(old.whitening, run.residual[:, :, None], run.errors) ** 2))
        return total

    def linearise(self, iterate: Iterate) -> _Linearised | None:
        """Eliminate the initial state of each window, then stack the rest with the priors.

        None where derivatives overflow.
        """
        k = len(self.names)
        blocks, rights, scores, eliminated = [], [], [], []
        cost = white_cost = 0.0
        for run, start in zip(iterate.runs, iterate.starts, strict=True):
            q = len(run.window.free)
            stack = np.concatenate([run.residual[:, :, None], run.by_start, run.by_parameter], axis=2)
            white = whiten(run.whitening, stack, run.errors)
            if not np.isfinite(white).all() or np.max(np.abs(white)) > 1e60:
                return None
            samples = white.shape[0]
            white = white.reshape(-1, 1 + q + k)
            prior = np.zeros((q, 1 + q + k))
            prior[:, 0] = _start_residual(run.window, start)
            prior[:, 1 : 1 + q] = np.diag(1.0 / run.window.spread[list(run.window.free)])
            rows = np.vstack([white, prior])
            squares = float(rows[:, 0] @ rows[:, 0])
            white_cost += squares
            cost += _noise_cost(run) + float(prior[:, 0] @ prior[:, 0]) if self.drive_errors else squares
            size = np.maximum(np.linalg.norm(rows[:, 1 : 1 + q], axis=0), 1e-30)
            # A tiny ridge keeps the elimination regular for a state that no residual depends on.
            Q, upper = np.linalg.qr(np.vstack([rows[:, 1 : 1 + q], np.diag(1e-8 * size)]))
            Q = Q[: len(rows)]
            by_parameter, residual = rows[:, 1 + q :], rows[:, 0]
            projected, shift = Q.T @ by_parameter, Q.T @ residual
            remaining, left = by_parameter - Q @ projected, residual - Q @ shift
            eliminated.append(_Elimination(upper, projected, shift, white.reshape(samples, -1, 1 + q + k)))
            blocks.append(remaining)
            rights.append(left)
            per_block = max(int(SCORE_TIME / run.window.log.sample_time), 1) * white.shape[0] // samples
            edges = np.arange(0, white.shape[0], per_block)
            scores.append(np.add.reduceat((remaining * left[:, None])[: white.shape[0]], edges, axis=0))
        prior_residual = (self.prior - iterate.values) * self.prior_weight
        cost += float(prior_residual @ prior_residual)
        white_cost += float(prior_residual @ prior_residual)
        stacked = np.vstack([*blocks, np.diag(self.prior_weight)])
        right = np.concatenate([*rights, prior_residual])
        size = np.linalg.norm(stacked, axis=0)
        size[size == 0.0] = 1.0
        Q, R = np.linalg.qr(stacked / size)
        R = R * size
        return _Linearised(iterate, cost, white_cost, R, Q.T @ right, R.T @ R, np.vstack(scores), tuple(eliminated))

    def step(self, here: _Linearised, damping: float) -> tuple[Iterate | None, float]:
        """The trial after a damped step, None if it diverges, and the decrease of the cost that linearity promises."""
        point = here.iterate
        step = self.parameter_step(here, damping)
        promised = float(here.right @ here.right - np.sum((here.right - here.R @ step) ** 2))
        promised += here.cost - here.white_cost
        # Initial states and input errors follow the parameters' step; damping shortens their own part too.
        share = 1.0 / (1.0 + damping)
        starts, errors = [], []
        for run, start, window in zip(point.runs, point.starts, here.eliminated, strict=True):
            moved, change = start.copy(), np.zeros(0)
            if run.window.free:
                change = np.linalg.solve(window.upper, window.residual - window.by_parameter @ step)
                moved[list(run.window.free)] += share * change
                promised += float(window.residual @ window.residual)
            starts.append(moved)
            if self.drive_errors and run.measured.input_sd > 0.0:
                left = window.white[:, :, 0] - window.white[:, :, 1:] @ np.concatenate([change, step])
                errors.append(run.errors + share * (smooth_input_errors(run.whitening, left) - run.errors))
            else:
                errors.append(run.errors)
        return self.simulate(point.values + step, starts, errors), promised

    def parameter_step(self, here: _Linearised, damping: float) -> np.ndarray:
        """Bounded, damped least-squares step (k,) in the parameters."""
        values, size = here.iterate.values, np.sqrt(np.diag(here.information))
        if not size.size:
            return np.zeros(0)
        # A parameter without any effect does not move.
        size[size == 0.0] = 1.0
        A = np.vstack([here.R / size, np.sqrt(damping) * np.eye(size.size)])
        b = np.concatenate([here.right, np.zeros(size.size)])
        # Trust region: no parameter beyond three times, or below a third of, its value in one step.
        low = np.maximum(self.lower - values, np.minimum(-0.67 * np.abs(values), -20.0 / size))
        high = np.minimum(self.upper - values, np.maximum(2.0 * np.abs(values), 20.0 / size))
        low, high = np.minimum(low * size, -1e-12), np.maximum(high * size, 1e-12)
        scaled = lsq_linear(A, b, bounds=(low, high), method="bvls").x
        return np.asarray(np.clip(scaled / size, self.lower - values, self.upper - values))


def _start_residual(window: ShootingWindow, start: np.ndarray) -> np.ndarray:
    """Distance of the free initial states from their estimate, in standard deviations."""
    free = list(window.free)
    return np.asarray((window.start[free] - start[free]) / window.spread[free])


def _noise_cost(run: WindowRun) -> float:
    """Sum of squares of all noise: the sensors' residuals and the input errors."""
    total = float(np.sum((run.residual / run.measured.sd) ** 2))
    if run.measured.input_sd > 0.0:
        total += float(np.sum((run.errors / run.measured.input_sd) ** 2))
    return total
