"""Refits: effect parameters and all nominal parameters are fitted together to a log by free-run simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from ..physics.effects import CandidateEffect, FreeNumber
from .hypothesis_model import Setting
from .objective import STEP, TEMPER, Objective, RunCount
from .records import Segment

#: A thorough fit renews its Jacobian at most so often; as many steps as pay are at most so many.
MOST_ROUNDS, MOST_STEPS = 6, 20
#: A step is tried so many times, each time shorter.
TRIALS = 4
#: An eigenvalue of a correlation matrix that counts as zero, and the share that a parameter has in such directions, as
#: a square, from which it is unknown. Rounding errors are below both.
NULL, UNKNOWN = 1e-12, 1e-6


def stated_sd(sd: float) -> float | None:
    """A standard deviation as a file states it: None if it is infinite, see `deviations_of`."""
    return sd if np.isfinite(sd) else None


@dataclass(frozen=True)
class HypothesisFit:
    """A hypothesis at its optimum.

    values: free parameters by name. cost: loss times TEMPER, plus priors. residual: (n,). jacobian: (n, k) derivatives
    by one scale of each of `free`, which lists the candidates' parameters first. settled: another refinement would not
    lower the cost.
    """

    candidates: tuple[CandidateEffect, ...]
    values: Mapping[str, float]
    cost: float
    residual: np.ndarray = field(repr=False)
    jacobian: np.ndarray = field(repr=False)
    free: tuple[FreeNumber, ...] = ()
    settled: bool = False

    @property
    def n_effect(self) -> int:
        """Number of free parameters of the candidate effects."""
        return sum(len(c.free) for c in self.candidates)

    @property
    def rms(self) -> float:
        """RMS of the residuals."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def prior_cost(self) -> float:
        """Sum of squares of the changes of the nominal parameters, in prior deviations."""
        return float(sum(((self.values[f.name] - f.nominal) / f.scale) ** 2 for f in self.free[self.n_effect :]))

    @property
    def sensitivities(self) -> dict[str, np.ndarray]:
        """Free parameter -> (n,) derivative of the residual."""
        return {f.name: column / f.scale for f, column in zip(self.free, self.jacobian.T, strict=True)}

    def information(self, objective: Objective) -> np.ndarray:
        """Information matrix (k, k) of data and priors, by the scales of `free`."""
        weighted = self.jacobian * objective.weights(self.residual)[:, None]
        # The level discounts residuals that errors of the model enlarge.
        information = TEMPER / objective.level * (weighted.T @ weighted)
        prior = np.arange(self.n_effect, len(self.free))
        information[prior, prior] += 1.0
        return np.asarray(information)

    def without(self, candidate: CandidateEffect, objective: Objective) -> dict[str, float]:
        """Start values of the hypothesis without one of its effects: a linear model expects the optimum there.

        The other numbers have made up for this effect, and move with it. It goes by its first number, which is neutral
        then, or by all of its nominal parameters, which return to their nominal values.
        """
        left = [n for n in candidate.names if n in objective.nominal.names] or [candidate.names[0]]
        places = [i for i, f in enumerate(self.free) if f.name in left and not f.fixed and np.isfinite(f.nominal)]
        values = {name: value for name, value in self.values.items() if name not in candidate.names}
        if not places:
            return values
        covariance = covariance_of(self.information(objective))
        back = np.array([(self.free[i].nominal - self.values[self.free[i].name]) / self.free[i].scale for i in places])
        moved = covariance[:, places] @ np.linalg.lstsq(covariance[np.ix_(places, places)], back, rcond=1e-9)[0]
        for f, z in zip(self.free, moved, strict=True):
            if f.name in values and not f.fixed:
                values[f.name] = float(np.clip(self.values[f.name] + z * f.scale, f.lower, f.upper))
        return values

    def with_level_of(self, objective: Objective) -> HypothesisFit:
        """The same fit with its cost under an objective with another level."""
        return replace(self, cost=TEMPER * objective.loss(self.residual) + self.prior_cost)


def covariance_of(information: np.ndarray) -> np.ndarray:
    """Covariance (k, k) by an information matrix (k, k), which may be singular."""
    return np.asarray(np.linalg.pinv(information, rcond=1e-12, hermitian=True))


def deviations_of(information: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) by an information matrix (k, k): infinite for what it knows nothing of."""
    found = np.full(len(information), np.inf)
    # Of numbers that the data tell one at a time, in units of these deviations: the scales of the numbers don't matter.
    told = np.flatnonzero(np.diag(information) > 0.0)
    alone = 1.0 / np.sqrt(np.diag(information)[told])
    values, vectors = np.linalg.eigh(information[np.ix_(told, told)] * np.outer(alone, alone))
    known = values > NULL
    together = np.sum(vectors[:, ~known] ** 2, axis=1) < UNKNOWN
    variances = vectors[:, known] ** 2 @ (1.0 / values[known])
    found[told[together]] = (alone * np.sqrt(variances))[together]
    return found


class _HypothesisProblem:
    """The least-squares problem of a hypothesis: parameter vector x (k,), residuals (n,), derivatives by one scale."""

    def __init__(
        self,
        objective: Objective,
        candidates: Sequence[CandidateEffect],
        free: tuple[FreeNumber, ...] | None = None,
    ) -> None:
        """free: by default those of the objective."""
        self.objective, self.candidates = objective, tuple(candidates)
        self.free = objective.free_numbers(candidates) if free is None else free
        self.names = [f.name for f in self.free]
        self.nominal, self.scale, self.lower, self.upper = (
            np.array([getattr(f, field) for f in self.free]) for field in ("nominal", "scale", "lower", "upper")
        )
        self.n_effect = sum(len(c.free) for c in candidates)

    def setting(self, x: np.ndarray) -> dict[str, float]:
        return dict(zip(self.names, x.tolist(), strict=True))

    def residual(self, x: np.ndarray) -> np.ndarray | None:
        return self.objective.residuals([self.setting(x)])[0]

    def prior_residual(self, x: np.ndarray) -> np.ndarray:
        return np.asarray((x[self.n_effect :] - self.nominal[self.n_effect :]) / self.scale[self.n_effect :])

    def cost(self, r: np.ndarray, x: np.ndarray) -> float:
        p = self.prior_residual(x)
        return TEMPER * self.objective.loss(r) + float(p @ p)

    def differentiate(self, which: Sequence[int], x: np.ndarray, r: np.ndarray, J: np.ndarray) -> None:
        """Fill these columns of J (n, k) by finite differences, with steps towards the interior of the bounds."""
        settings, steps = [], []
        for i in which:
            h = (
                0.3 * self.scale[i]
                if i < self.n_effect
                else min(0.3 * self.scale[i], STEP * abs(self.nominal[i]) or np.inf)
            )
            h = -h if x[i] + h > self.upper[i] else h
            moved = x.copy()
            moved[i] += h
            settings.append(self.setting(moved))
            steps.append(h)
        for i, h, changed in zip(which, steps, self.objective.residuals(settings), strict=True):
            J[:, i] = 0.0 if changed is None else (changed - r) * (self.scale[i] / h)

    def normal_equations(
        self, J: np.ndarray, r: np.ndarray, x: np.ndarray, w: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Newton matrix (k, k) and gradient (k,) of half the cost, with weights w (n,)."""
        weighted = J * w[:, None]
        G = TEMPER * (weighted.T @ weighted)
        g = TEMPER * (weighted.T @ (w * r))
        prior = np.arange(self.n_effect, len(self.free))
        G[prior, prior] += 1.0
        g[self.n_effect :] += self.prior_residual(x)
        return G, g

    def fit(
        self,
        x: np.ndarray,
        r: np.ndarray,
        J: np.ndarray,
        steps: int | None,
        renew_after: int = 0,
        *,
        exact: bool = False,
    ) -> HypothesisFit:
        """Steps from x (k,) with residuals r (n,) and Jacobian J (n, k); see `refit`. exact: J was computed there."""
        fixed = [i for i, number in enumerate(self.free) if number.fixed]
        self.lower[fixed] = self.upper[fixed] = x[fixed]
        cost, damping, drop, gained, settled = self.cost(r, x), 1e-3, np.inf, False, False
        renewed = exact or not renew_after
        # A Jacobian that was taken over counts as if it had been computed: that is the price of a new one.
        spent, first = len(self.free), cost
        for step in range(MOST_STEPS if steps is None else steps):
            if step == renew_after and not renewed:
                self.differentiate(range(len(self.free)), x, r, J)
                exact = renewed = True
            w = self.objective.weights(r)
            G, g = self.normal_equations(J, r, x, w)
            gained, settled, trials = False, exact, 0
            while not gained and trials < TRIALS:
                trials += 1
                z = _bounded_step(G, g, damping, (self.lower - x) / self.scale, (self.upper - x) / self.scale)
                trial = np.clip(x + z * self.scale, self.lower, self.upper)
                z = (trial - x) / self.scale
                new = self.residual(trial)
                if new is None:
                    damping = max(10.0 * damping, 1e-2)
                    continue
                J += np.outer(new - r - J @ z, z / max(float(z @ z), 1e-12))
                c = self.cost(new, trial)
                if c < cost:
                    gained, exact = True, False
                    drop = cost - c
                    x, r, cost = trial, new, c
                    damping = max(0.2 * damping, 1e-6)
                else:
                    G, g = self.normal_equations(J, r, x, w)
                    damping = max(10.0 * damping, 1e-2)
            if not gained and not renewed:
                # The Jacobian may be too far off: it was computed at another point and updated.
                self.differentiate(range(len(self.free)), x, r, J)
                exact = renewed = True
                damping = 1e-2
                continue
            if not gained or drop < self.objective.converged:
                break
            spent += trials
            if steps is None and drop * spent < (first - cost) * trials:
                break
        settled = settled and (not gained or drop < self.objective.converged)
        return HypothesisFit(self.candidates, self.setting(x), cost, r, J, self.free, settled)


def refit(
    objective: Objective,
    candidates: Sequence[CandidateEffect],
    start: Setting,
    sensitivities: Mapping[str, np.ndarray],
    *,
    steps: int | None = 6,
    renew_after: int = 0,
) -> HypothesisFit | None:
    """Damped Gauss-Newton from `start` with Broyden's update of the Jacobian; None if the start can't be simulated.

    sensitivities: parameter -> (n,) derivative of the residual near the start; others are computed. steps: as in
    `refine`. renew_after: number of steps after which the Jacobian is recomputed, or before if a step fails (0: it is
    not).

    Sources: K. Levenberg, "A method for the solution of certain non-linear problems in least squares", Quarterly of
    Applied Mathematics 2 (1944); C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations",
    Mathematics of Computation 19 (1965).
    """
    problem = _HypothesisProblem(objective, candidates)
    x = np.array([start.get(f.name, f.nominal) for f in problem.free])
    r = problem.residual(x)
    if r is None:
        return None
    J = np.zeros((r.size, len(problem.free)))
    for i, name in enumerate(problem.names):
        if name in sensitivities:
            J[:, i] = sensitivities[name] * problem.scale[i]
    missing = [i for i, name in enumerate(problem.names) if name not in sensitivities]
    problem.differentiate(missing, x, r, J)
    return problem.fit(x, r, J, steps, renew_after, exact=len(missing) == len(problem.free))


def fit_on(objective: Objective, fit: HypothesisFit) -> HypothesisFit | None:
    """The same values and free numbers as a fit to other data; None if they can't be simulated there."""
    problem = _HypothesisProblem(objective, fit.candidates, fit.free)
    x = np.array([fit.values[name] for name in problem.names])
    r = problem.residual(x)
    if r is None:
        return None
    J = np.zeros((r.size, len(problem.free)))
    problem.differentiate(range(len(problem.free)), x, r, J)
    return problem.fit(x, r, J, steps=0, exact=True)


def refine(objective: Objective, fit: HypothesisFit, steps: int | None) -> HypothesisFit:
    """Continue a fit with a new Jacobian.

    steps: at most so many. None: as many as pay, up to the first that lowers the cost, per simulation, by less than the
    average since the Jacobian, whose own simulations count too: a new one pays better then.
    """
    problem = _HypothesisProblem(objective, fit.candidates)
    x = np.array([fit.values[name] for name in problem.names])
    J = np.empty_like(fit.jacobian)
    problem.differentiate(range(len(problem.free)), x, fit.residual, J)
    return problem.fit(x, fit.residual, J, steps, exact=True)


def refit_until_converged(
    objective: Objective,
    candidates: Sequence[CandidateEffect],
    start: Setting,
    sensitivities: Mapping[str, np.ndarray] | None = None,
) -> HypothesisFit | None:
    """A fit from `start` until its cost no longer falls with a new Jacobian; None if the start can't be simulated.

    sensitivities: of a fit nearby, see `refit`.
    """
    fit = refit(objective, candidates, start, sensitivities or {}, steps=None)
    for _ in range(MOST_ROUNDS):
        if fit is None or fit.settled:
            break
        before, fit = fit.cost, refine(objective, fit, None)
        if fit.cost > before - objective.converged:
            break
    return fit


def refit_by_windows(objective: Objective, windows: Segment, start: Setting, fit: HypothesisFit) -> HypothesisFit:
    """The better of a converged fit and of one from where a fit over short windows leads.

    The cost of a long free run is a rough function of the parameters where the rod sticks and slips: a slip that comes
    late spoils all that follows. Over windows that begin with measured states it is smoother. That is the idea of
    multiple shooting (F. Carbonell et al., arXiv:1507.00975, 2015, with further references).

    windows: training data in short windows. start: of the fit over them.
    """
    smooth = replace(objective, segment=windows)
    over_windows = refit_until_converged(smooth, fit.candidates, start)
    if over_windows is None:
        return fit
    again = refit_until_converged(objective, fit.candidates, over_windows.values, fit.sensitivities)
    return fit if again is None else min(fit, again, key=lambda one: one.cost)


def refit_nominal(objective: Objective, sensitivities: Mapping[str, np.ndarray], prior_factor: float = 1.0) -> Setting:
    """Fit the nominal parameters alone, with prior deviations times `prior_factor`; empty if that fails.

    sensitivities: see `objective_of`.
    """
    nominal = replace(objective.nominal, sd=objective.nominal.sd * prior_factor)
    wide = replace(objective, nominal=nominal, level=1.0, count=RunCount())
    found = refit(wide, (), {}, sensitivities, steps=8, renew_after=2)
    return {} if found is None else found.values


def _bounded_step(G: np.ndarray, g: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step within bounds, and within 20 scales, that minimises the damped quadratic model."""
    D = np.diag(np.maximum(np.diag(G), 1e-9))
    H = G + damping * D + 1e-10 * np.eye(len(G))
    L = np.linalg.cholesky(H)
    target = -np.linalg.solve(L, g)
    low, high = np.minimum(np.maximum(low, -20.0), -1e-12), np.maximum(np.minimum(high, 20.0), 1e-12)
    return np.asarray(lsq_linear(L.T, target, bounds=(low, high), method="bvls").x)
