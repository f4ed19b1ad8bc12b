"""The search for tuned PID gains.

A grid of designs by crossover and phase finds feasible gains; sequential quadratic programming in the logarithms of the
gains improves the best few. If the grid has no feasible design, the search first minimises the largest violation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..kinds.pid import Gains
from .constraints import LOWER_BOUNDS, LoopConstraints, PidLoop, SampledPlant, Tuning

#: Number of starts of the local search (engineering judgement), relative violation of a bound that counts as rounding,
#: and violation (logarithm) up to which gains count as feasible during the search.
STARTS, TOLERANCE, SEARCH_TOLERANCE = 3, 1e-6, 1e-4


class GainSearch:
    """The optimisation over theta, the logarithms of k_p, k_i / k_p, k_d / k_p and T_f."""

    def __init__(self, plants: list[SampledPlant], tuning: Tuning, b: float, c: float) -> None:
        self.plants, self.tuning, self.b, self.c = plants, tuning, b, c
        self.constraints = [LoopConstraints(plant, tuning.bounds()) for plant in plants]
        self.samples = 1024

    def tighten(self, amounts: dict[str, float]) -> None:
        """Make bounds stricter by these factors, given as logarithms."""
        bounds = dict(self.constraints[0].bounds)
        for name, amount in amounts.items():
            bounds[name] *= float(np.exp(amount if name in LOWER_BOUNDS else -amount))
        self.constraints = [LoopConstraints(plant, bounds) for plant in self.plants]

    def feasible(self, gains: Gains) -> bool:
        return bool(np.min(self.slack(gains)) > -SEARCH_TOLERANCE)

    def gains(self, theta: np.ndarray) -> Gains:
        values = iter(np.exp(theta))
        k_p = next(values)
        k_i = k_p * next(values) if "I" in self.tuning.terms else 0.0
        return Gains(k_p, k_i, k_p * next(values), next(values)) if "D" in self.tuning.terms else Gains(k_p, k_i)

    def theta(self, gains: Gains) -> np.ndarray:
        values = [gains.k_p]
        if "I" in self.tuning.terms:
            values.append(gains.k_i / gains.k_p)
        if "D" in self.tuning.terms:
            values += [gains.k_d / gains.k_p, gains.T_f]
        return np.log(values)

    def slack(self, gains: Gains) -> np.ndarray:
        return np.concatenate([one.slack(gains) for one in self.constraints])

    def objective(self, gains: Gains) -> float:
        """Logarithm of the criterion; a large finite number for an unstable loop."""
        if self.tuning.minimise == "IE":
            return float(-np.log(gains.k_i))
        T_s = self.plants[0].sample_time
        with np.errstate(all="ignore"):
            error = np.abs(PidLoop(self.plants[0], gains, self.b, self.c).error(self.samples, self.tuning.response))
            time = T_s * np.arange(error.size) if self.tuning.minimise == "ITAE" else 1.0
            total = T_s * np.sum(time * error)
        return float(np.log(np.clip(total, 1e-300, 1e100))) if np.isfinite(total) else 230.0

    def solve(self) -> Gains:
        """The best gains found, or those with the smallest violation if none is feasible."""
        grid = self.grid()
        slacks = np.array([np.min(self.slack(gains)) for gains in grid])
        feasible = [grid[k] for k in np.flatnonzero(slacks >= 0.0)]
        if not feasible:
            tried = [self.nearest_to_feasible(grid[k]) for k in np.argsort(-slacks)[:STARTS]]
            feasible = [max(tried, key=lambda gains: float(np.min(self.slack(gains))))]
            if not self.feasible(feasible[0]):
                return feasible[0]
        # Strong gains reject a load best: compare the responses of the 40 strongest only.
        feasible = sorted(feasible, key=lambda gains: -(gains.k_i or gains.k_p))[:40]
        self.set_horizon(feasible)
        feasible.sort(key=self.objective)
        return min([*(self.search(gains) for gains in spread(feasible, self.theta)), feasible[0]], key=self._rank)

    def _rank(self, gains: Gains) -> tuple[float, float]:
        violation = -float(np.min(self.slack(gains)))
        return (violation if violation > SEARCH_TOLERANCE else 0.0), self.objective(gains)

    def set_horizon(self, candidates: list[Gains]) -> None:
        """Choose the number of samples for which the faster half of the loops settles, 128 to 8192."""
        radius = np.median([PidLoop(self.plants[0], gains).radius() for gains in candidates])
        self.samples = int(2 ** np.clip(np.ceil(np.log2(12.0 / max(1.0 - radius, 1e-6))), 7, 13))

    def grid(self) -> list[Gains]:
        """Designs over a grid of crossover, phase lead, and corners of integral action and filter."""
        # Coarse, engineering judgement: every start only has to be near a local optimum.
        T_s = self.plants[0].sample_time
        nyquist = np.pi / T_s
        integral = (0.03, 0.1, 0.3) if "I" in self.tuning.terms else (0.0,)
        leads = np.radians((0.0, 25.0, 45.0, 60.0)) if "D" in self.tuning.terms else (0.0,)
        filters = (4.0, 20.0) if "D" in self.tuning.terms else (np.inf,)
        found = []
        for omega in np.geomspace(1e-3 * nyquist, 0.4 * nyquist, 18):
            z = np.exp(1j * np.array([omega * T_s]))
            size = abs(self.plants[0].response(z)[0])
            for lead, ratio, corner in product(leads, integral, filters):
                T_d = np.tan(lead) / omega
                shape = Gains(1.0, ratio * omega, T_d, 1.0 / (corner * omega) if T_d else 0.0)
                k = 1.0 / (size * abs(complex(np.ravel(shape.response(z, T_s))[0])))
                if "D" in self.tuning.terms and not T_d:
                    shape = replace(shape, k_d=1e-3 / omega, T_f=1.0 / (corner * omega))
                found.append(Gains(k, k * shape.k_i, k * shape.k_d, max(shape.T_f, 0.05 * T_s) if shape.k_d else 0.0))
        return found

    def limits(self, theta: np.ndarray) -> list[tuple[float, float]]:
        # Wide enough never to matter: a factor of exp(9) = 8000 to either side of the start.
        spans = [(value - 9.0, value + 9.0) for value in theta]
        if "D" in self.tuning.terms:
            T_s = self.plants[0].sample_time
            spans[-1] = (np.log(0.05 * T_s), np.log(500.0 * T_s))
        return spans

    def search(self, start: Gains) -> Gains:
        """The local optimum from a start."""
        theta = self.theta(start)
        found = minimise(
            lambda t: self.objective(self.gains(t)), theta, self.limits(theta), lambda t: self.slack(self.gains(t))
        )
        return self.gains(found)

    def nearest_to_feasible(self, start: Gains) -> Gains:
        """Gains with the smallest largest violation near a start."""
        theta, slack = self.theta(start), -float(np.min(self.slack(start)))
        found = minimise(
            lambda t: t[-1],
            np.append(theta, slack),
            [*self.limits(theta), (-0.02, None)],
            lambda t: self.slack(self.gains(t[:-1])) + t[-1],
        )
        return max((start, self.gains(found[:-1])), key=lambda gains: float(np.min(self.slack(gains))))


def minimise(
    objective: Callable[[np.ndarray], float],
    start: np.ndarray,
    limits: Sequence[tuple[float, float | None]],
    slack: Callable[[np.ndarray], np.ndarray],
    *,
    step: float = 1.5e-8,
) -> np.ndarray:
    """Minimise subject to slack >= 0 by sequential quadratic programming; `step` of the differences."""
    from scipy.optimize import minimize

    with np.errstate(all="ignore"):
        result = minimize(
            objective, start, method="SLSQP", bounds=limits, constraints={"type": "ineq", "fun": slack},
            options={"maxiter": 100, "ftol": 1e-9, "eps": step},
        )  # fmt: skip
    return np.asarray(result.x)


def spread(sorted_gains: list[Gains], theta: Callable[[Gains], np.ndarray]) -> list[Gains]:
    """The first few gains of a sorted list that differ by more than exp(0.5) in one of theta."""
    chosen: list[Gains] = []
    for gains in sorted_gains:
        if all(np.max(np.abs(theta(gains) - theta(other))) > 0.5 for other in chosen):
            chosen.append(gains)
        if len(chosen) == STARTS:
            break
    return chosen
