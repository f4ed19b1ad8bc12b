"""Damped Gauss-Newton on whitened simulation errors, the windows' initial states eliminated exactly.

Each window has an initial state of its own. It touches that window's residuals alone, so that an orthogonal
decomposition per window leaves a small problem in the parameters (variable projection; G. H. Golub, V. Pereyra, SIAM
J. Numer. Anal. 10(2), 1973, for a linear rest: here it is linear to first order, as the whole step is). The small
problem is solved with its bounds by `scipy.optimize.lsq_linear`; damping grows until a step lowers the true cost.

Two costs are there. With the errors of the logged drive left out of the simulation, the whitening of a run stands for
them; it belongs to the run, hence to the parameters, so that within a step it is held fixed and made anew afterwards
(iteratively reweighted least squares). With the errors as unknowns of their own, the cost is the sum of squares of
everything that is supposed to be small: sensors' noise and drive's errors. To first order both have their minimum at
the same parameters. Where friction holds the rod until the drive passes a threshold, first order is not enough: a
simulation by the noisy log breaks away at the first peak of its noise, and the second cost is the right one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear

from ..core.errors import InputError, SimulationError
from ..plant.plant import Plant
from .free import FreeParameter, with_values
from .residual import WindowRun, run_window
from .window import Window

#: A step that promises less than this share of the cost, or moves each parameter by less than this share of its
#: standard deviation, is the last one.
ENOUGH_COST, ENOUGH_STEP = 1e-6, 1e-2


@dataclass(frozen=True)
class Point:
    """Parameters, initial states and errors of the drive with what the simulation makes of them."""

    values: np.ndarray
    starts: tuple[np.ndarray, ...]
    errors: tuple[np.ndarray, ...]
    runs: tuple[WindowRun, ...]


@dataclass(frozen=True)
class Progress:
    """What a watcher is told after each step: which stage, how many steps, the cost per residual, the values."""

    stage: str
    step: int
    cost: float
    names: tuple[str, ...]
    values: np.ndarray


@dataclass(frozen=True)
class Fit:
    """An estimate over some windows.

    values (k,). cost: sum of squares of whitened residuals and priors; lowered: the cost that was minimised, which
    without unknown errors of the drive is the same. weighted: by other weights than the sensors' noise. residuals: how
    many. information (k, k): the inverse of the covariance that the noise alone gives. scores (blocks, k): gradient of
    each half second, by which one sees whether residuals hang together. stopped: why it ended.
    """

    parameters: tuple[FreeParameter, ...]
    plant: Plant
    point: Point
    cost: float
    lowered: float
    weighted: bool
    residuals: int
    information: np.ndarray
    scores: np.ndarray
    steps: int
    stopped: str
    history: tuple[float, ...] = field(repr=False)

    @property
    def values(self) -> np.ndarray:
        return self.point.values

    @property
    def worst_blocks(self) -> tuple[tuple[float, int], ...]:
        """Of each run the tenth of a second that fits worst: by how many standard deviations of its sum, and where.

        The overall cost hides one missed slip among thousands of samples; in its own block it stands out.
        """
        found = []
        for run in self.point.runs:
            squares = np.sum((run.residual / run.measurement.sd) ** 2, axis=1)
            if run.measurement.input_sd > 0.0:
                squares = squares + (run.errors / run.measurement.input_sd) ** 2
            length = min(max(int(round(SPOT / run.window.log.sample_time)), 1), squares.size)
            sums = np.convolve(squares, np.ones(length), mode="valid")
            expected = length * run.residual.shape[1]
            at = int(np.argmax(sums))
            found.append((float((sums[at] - expected) / np.sqrt(2.0 * expected)), at + length // 2))
        return tuple(found)

    @property
    def worst_block(self) -> tuple[float, int, int]:
        """The worst of them all: by how many standard deviations, in which run, where."""
        number = int(np.argmax([size for size, _ in self.worst_blocks]))
        size, at = self.worst_blocks[number]
        return size, number, at

    @property
    def reduced_cost(self) -> float:
        """Cost per degree of freedom: one when model and noise are right."""
        return self.cost / self._freedom

    @property
    def noise_ratio(self) -> float:
        """The larger of both costs per degree of freedom.

        At a minimum where first order holds they agree. A run that has missed slips, or that runs away, may look white
        to its own filter, which takes the unstable direction for noise of the drive; the errors that this would need
        are then far beyond the drive's noise, and the cost that was minimised shows it.
        """
        return max(self.cost, self.lowered) / self._freedom

    @property
    def _freedom(self) -> int:
        states = sum(len(run.window.free) for run in self.point.runs)
        return max(self.residuals - self.values.size - states, 1)


#: Length of a piece in which one missed slip stands out, s.
SPOT = 0.1
#: Length of a block of scores, s: longer than what the residuals of a wrong model remember, mostly.
BLOCK = 0.5


def fit(
    plant: Plant,
    windows: Sequence[Window],
    parameters: Sequence[FreeParameter],
    *,
    start: np.ndarray | None = None,
    begin: Point | None = None,
    drive_errors: bool = True,
    weights: Mapping[str, float] | None = None,
    steps: int = 40,
    stage: str = "",
    watch: Callable[[Progress], None] | None = None,
    keep: Callable[[Fit], None] | None = None,
    tolerance: float = 1e-6,
    enough: float = ENOUGH_COST,
) -> Fit:
    """Minimise the whitened simulation error over windows.

    Parameters
    ----------
    start: (k,) parameter values to begin with; the plant's by default. begin: go on from here, with its initial states
        and errors of the drive.
    drive_errors: take the errors of the logged drive as unknowns of their own (the second cost above).
    weights: channel -> standard deviation, instead of the sensors' noise and the drive's.
    steps: at most so many accepted steps.
    watch: is told of each step. keep: is given the fit so far after each step, for work that may be interrupted.
    enough: relative gain of cost below which it ends.

    Raises
    ------
    InputError: the plant can't be simulated over the windows even at the start.
    """
    problem = _Problem(plant, tuple(windows), tuple(parameters), drive_errors, weights, tolerance)
    names = problem.names
    values = np.array([p.value for p in parameters]) if start is None else np.array(start, dtype=float)
    if begin is not None:
        values = begin.values
    values = np.clip(values, problem.lower, problem.upper)
    states = tuple(window.start for window in windows) if begin is None else begin.starts
    errors = tuple(np.zeros(len(window)) for window in windows) if begin is None else begin.errors
    first = problem.run(values, states, errors)
    reduced = problem.reduce(first) if first is not None else None
    if first is None or reduced is None:
        raise InputError(
            f"{plant.name} can't be simulated along the log with "
            + ", ".join(f"{name} = {value:g}" for name, value in zip(names, values, strict=True))
            + ": the run leaves the range where the equations hold; start nearer or use shorter windows"
        )
    point, damping, done, stopped, history = first, 1e-3, 0, "no steps were left", []
    while done < steps:
        history.append(reduced.white_cost)
        accepted = there = None
        for _ in range(8):
            step = problem.solve(reduced, point, damping)
            trial = problem.run(point.values + step.values, step.starts, step.errors)
            if trial is not None:
                cost = problem.cost(trial, point)
                there = problem.reduce(trial) if cost < reduced.cost else None
                if there is not None:
                    accepted = trial
                    gain = (reduced.cost - cost) / max(reduced.cost, 1e-300)
                    ratio = (reduced.cost - cost) / max(step.promised, 1e-300)
                    damping = max(damping * (0.1 if ratio > 0.7 else 0.5 if ratio > 0.3 else 2.0), 1e-9)
                    break
            if step.promised < 1e-9 * reduced.cost:
                break
            damping = max(damping * 8.0, 1e-6)
        if accepted is None or there is None:
            stopped = "no step lowers the cost any more"
            break
        moved = np.abs(accepted.values - point.values) @ np.diag(np.sqrt(np.diag(reduced.information)))
        point, reduced, done = accepted, there, done + 1
        if keep is not None:
            keep(problem.result(point, reduced, done, "interrupted", history))
        if watch is not None:
            watch(Progress(stage, done, reduced.white_cost / problem.residuals, names, point.values))
        if gain < enough or (moved.size and np.max(moved) < ENOUGH_STEP and damping <= 1e-2):
            stopped = "converged"
            break
    return problem.result(point, reduced, done, stopped, history)


@dataclass(frozen=True)
class _Reduced:
    """The problem linearised at a point: R (k, k) and right side (k,) after elimination of the initial states.

    cost: what a step has to lower. white_cost: sum of squares of the whitened residuals and priors.
    """

    cost: float
    white_cost: float
    R: np.ndarray
    right: np.ndarray
    information: np.ndarray
    scores: np.ndarray
    back: tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class _Step:
    values: np.ndarray
    starts: tuple[np.ndarray, ...]
    errors: tuple[np.ndarray, ...]
    promised: float


class _Problem:
    def __init__(
        self,
        plant: Plant,
        windows: tuple[Window, ...],
        parameters: tuple[FreeParameter, ...],
        drive_errors: bool,
        weights: Mapping[str, float] | None,
        tolerance: float,
    ) -> None:
        self.plant, self.windows, self.parameters = plant, windows, parameters
        self.drive_errors, self.weights, self.tolerance = drive_errors, weights, tolerance
        self.names = tuple(parameter.name for parameter in parameters)
        self.lower = np.array([parameter.lower for parameter in parameters])
        self.upper = np.array([parameter.upper for parameter in parameters])
        self.prior = np.array([parameter.value for parameter in parameters])
        self.prior_weight = np.array([1.0 / p.prior_sd if p.prior_sd else 0.0 for p in parameters])
        self.residuals = 0

    def run(self, values: np.ndarray, starts: tuple[np.ndarray, ...], errors: tuple[np.ndarray, ...]) -> Point | None:
        """Simulate all windows; None if one of them can't be finished."""
        try:
            plant = with_values(self.plant, self.names, values)

            def one(window: Window, start: np.ndarray, error: np.ndarray) -> WindowRun:
                return run_window(
                    plant, window, start, self.names, errors=error, weights=self.weights, tolerance=self.tolerance
                )

            if len(self.windows) == 1:
                runs = [one(self.windows[0], starts[0], errors[0])]
            else:
                with ThreadPoolExecutor(2) as pool:
                    runs = list(pool.map(one, self.windows, starts, errors))
        except (SimulationError, FloatingPointError):
            return None
        if not all(np.isfinite(run.residual).all() and np.abs(run.by_parameter).max() < 1e30 for run in runs):
            return None
        self.residuals = sum(run.residual.size for run in runs)
        return Point(values, starts, errors, tuple(runs))

    def cost(self, trial: Point, base: Point) -> float:
        """What a trial has to lower; without the drive's errors in the whitening of the point it was stepped from."""
        total = float(np.sum(((trial.values - self.prior) * self.prior_weight) ** 2))
        for run, old, start in zip(trial.runs, base.runs, trial.starts, strict=True):
            total += float(np.sum(self._pull(run.window, start) ** 2))
            if self.drive_errors:
                total += _noise(run)
            else:
                total += float(np.sum(old.whitening(run.residual[:, :, None], run.errors) ** 2))
        return total

    @staticmethod
    def _pull(window: Window, start: np.ndarray) -> np.ndarray:
        """How far the free initial states are from what is known of them, in standard deviations."""
        free = list(window.free)
        return (window.start[free] - start[free]) / window.spread[free]

    def reduce(self, point: Point) -> _Reduced | None:
        """Linearise: per window eliminate the initial state, then stack what is left with the priors.

        None where derivatives have run away beyond what numbers can hold.
        """
        k = len(self.names)
        blocks, rights, scores, back = [], [], [], []
        cost = white_cost = 0.0
        for run, start in zip(point.runs, point.starts, strict=True):
            q = len(run.window.free)
            stack = np.concatenate([run.residual[:, :, None], run.by_start, run.by_parameter], axis=2)
            white = run.whitening(stack, run.errors)
            if not np.isfinite(white).all() or np.max(np.abs(white)) > 1e60:
                return None
            samples = white.shape[0]
            white = white.reshape(-1, 1 + q + k)
            pull = np.zeros((q, 1 + q + k))
            pull[:, 0] = self._pull(run.window, start)
            pull[:, 1 : 1 + q] = np.diag(1.0 / run.window.spread[list(run.window.free)])
            everything = np.vstack([white, pull])
            squares = float(everything[:, 0] @ everything[:, 0])
            white_cost += squares
            cost += _noise(run) + float(pull[:, 0] @ pull[:, 0]) if self.drive_errors else squares
            size = np.maximum(np.linalg.norm(everything[:, 1 : 1 + q], axis=0), 1e-30)
            # A direction that nothing depends on gets a faint pull to stay, so that the elimination is always possible.
            faint = np.hstack([np.zeros((q, 1)), np.diag(1e-8 * size), np.zeros((q, k))])
            Q, upper = np.linalg.qr(np.vstack([everything[:, 1 : 1 + q], faint[:, 1 : 1 + q]]))
            Q = Q[: len(everything)]
            by_parameter, residual = everything[:, 1 + q :], everything[:, 0]
            link, shift = Q.T @ by_parameter, Q.T @ residual
            rest, left = by_parameter - Q @ link, residual - Q @ shift
            back.append((upper, link, shift, white.reshape(samples, -1, 1 + q + k)))
            blocks.append(rest)
            rights.append(left)
            per_block = max(int(BLOCK / run.window.log.sample_time), 1) * white.shape[0] // samples
            product = rest * left[:, None]
            edges = np.arange(0, white.shape[0], per_block)
            scores.append(np.add.reduceat(product[: white.shape[0]], edges, axis=0))
        prior = np.diag(self.prior_weight)
        pull = (self.prior - point.values) * self.prior_weight
        cost += float(pull @ pull)
        white_cost += float(pull @ pull)
        stacked = np.vstack([*blocks, prior])
        right = np.concatenate([*rights, pull])
        size = np.linalg.norm(stacked, axis=0)
        size[size == 0.0] = 1.0
        Q, R = np.linalg.qr(stacked / size)
        R = R * size
        return _Reduced(cost, white_cost, R, Q.T @ right, R.T @ R, np.vstack(scores), tuple(back))

    def solve(self, reduced: _Reduced, point: Point, damping: float) -> _Step:
        """Bounded, damped least-squares step in the parameters, and the initial states' step that goes with it."""
        size = np.sqrt(np.diag(reduced.information))
        # A parameter without any effect stays where it is.
        size[size == 0.0] = 1.0
        if not size.size:
            return self._follow(reduced, point, damping, np.zeros(0))
        A = np.vstack([reduced.R / size, np.sqrt(damping) * np.eye(size.size)])
        b = np.concatenate([reduced.right, np.zeros(size.size)])
        # No parameter at more than three times, or less than a third of, its value in one step.
        reach = np.maximum(2.0 * np.abs(point.values), 20.0 / size)
        low = np.maximum(self.lower - point.values, np.minimum(-0.67 * np.abs(point.values), -20.0 / size))
        high = np.minimum(self.upper - point.values, reach)
        low, high = np.minimum(low * size, -1e-12), np.maximum(high * size, 1e-12)
        scaled = lsq_linear(A, b, bounds=(low, high), method="bvls").x
        step = np.clip(scaled / size, self.lower - point.values, self.upper - point.values)
        return self._follow(reduced, point, damping, step)

    def _follow(self, reduced: _Reduced, point: Point, damping: float, step: np.ndarray) -> _Step:
        """The steps of initial states and drive's errors that go with a step of the parameters."""
        promised = float(reduced.right @ reduced.right - np.sum((reduced.right - reduced.R @ step) ** 2))
        promised += reduced.cost - reduced.white_cost
        # Initial states and errors follow the parameters' step; damping shortens their own part of the way too.
        share = 1.0 / (1.0 + damping)
        starts, errors = [], []
        for run, start, (upper, link, shift, white) in zip(point.runs, point.starts, reduced.back, strict=True):
            moved, change = start.copy(), np.zeros(0)
            if run.window.free:
                change = np.linalg.solve(upper, shift - link @ step)
                moved[list(run.window.free)] += share * change
                promised += float(shift @ shift)
            starts.append(moved)
            if self.drive_errors and run.measurement.input_sd > 0.0:
                left = white[:, :, 0] - white[:, :, 1:] @ np.concatenate([change, step])
                errors.append(run.errors + share * (run.whitening.errors(left) - run.errors))
            else:
                errors.append(run.errors)
        return _Step(step, tuple(starts), tuple(errors), promised)

    def result(self, point: Point, reduced: _Reduced, steps: int, stopped: str, history: list[float]) -> Fit:
        return Fit(
            parameters=self.parameters,
            plant=with_values(self.plant, self.names, point.values),
            point=point,
            cost=reduced.white_cost,
            lowered=reduced.cost,
            weighted=self.weights is not None,
            residuals=self.residuals,
            information=reduced.information,
            scores=reduced.scores,
            steps=steps,
            stopped=stopped,
            history=(*history, reduced.white_cost),
        )


def _noise(run: WindowRun) -> float:
    """Sum of squares of everything that is noise: the sensors' residuals and the drive's errors."""
    total = float(np.sum((run.residual / run.measurement.sd) ** 2))
    if run.measurement.input_sd > 0.0:
        total += float(np.sum((run.errors / run.measurement.input_sd) ** 2))
    return total
