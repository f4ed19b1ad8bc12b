"""Tuning of any kind of controller by the keys of its definition that the kind declares free.

The criterion and the bounds are those of a tuned PID (constraints.py): the integrated error of a step response of the
sampled linear loop under bounds on Ms, Mt, disk margin and noise gain. Every kind has the same number of evaluations,
so that kinds that are compared are tuned alike.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.controller_interface import MEASURED, REFERENCE
from ...core.errors import InputError
from ..analysis.closed_loop import (
    INPUTS,
    OUTPUTS,
    closed_loop,
    discrete_response,
    linear_law,
    spectral_radius,
    unit_step,
)
from ..analysis.sampled import sampled_plant
from .constraints import LOWER_BOUNDS, Tuning, bound_slack, frequency_points
from .search import minimise

if TYPE_CHECKING:
    from collections.abc import Callable

    import control

#: Evaluations of the loop, of them scattered starts, and number of local searches. Engineering judgement.
BUDGET, SCATTERED, SEARCHES = 400, 64, 3
#: Duration of the step response [s]; step of the differences in the logarithm of a key; margin by which bounds are
#: stricter in the search than asked (logarithm), for peaks between grid points and rounded values.
DURATION, DIFFERENCE, STRICTER = 1.0, 1e-4, 5e-3
#: Value and slack of keys that give no controller.
WORST = 1e3


class _BudgetSpentError(Exception):
    """No evaluation is left."""


@dataclass(frozen=True)
class TunedKeys:
    """Result of `tune_keys`.

    Attributes
    ----------
    values: dotted key -> SI value. objective: the minimised integral [m s per A, m s2 for ITAE; per m for a reference].
    evaluations: of the loop.
    """

    values: Mapping[str, float]
    objective: float
    evaluations: int


@dataclass
class KeySearch:
    """The search over the logarithms of some keys.

    Attributes
    ----------
    build: values of the keys (k,) -> controller; raises InputError for values that give none.
    system: linear model. tuning: criterion and bounds. limits: (k, 2) of the keys, SI units.
    seen: logarithms of the keys -> criterion (logarithm) and slack.
    """

    build: Callable[[np.ndarray], Any]
    system: control.StateSpace
    tuning: Tuning
    limits: np.ndarray
    sample_time: float
    budget: int = BUDGET
    seen: dict[bytes, tuple[np.ndarray, float, np.ndarray]] = field(default_factory=dict)

    @cached_property
    def bounds(self) -> dict[str, float]:
        return {
            name: value * float(np.exp(STRICTER if name in LOWER_BOUNDS else -STRICTER))
            for name, value in self.tuning.bounds().items()
        }

    @cached_property
    def plant(self) -> control.StateSpace:
        return sampled_plant(self.system, self.sample_time, delay=self.tuning.lag * self.sample_time)

    @cached_property
    def grid(self) -> np.ndarray:
        points = frequency_points(self.sample_time)
        return np.append(points, self.bounds["crossover"]) if "crossover" in self.bounds else points

    @cached_property
    def G(self) -> np.ndarray:
        return discrete_response(self.plant, self.grid)[:, :, 0]

    def evaluate(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Criterion (logarithm) and slack of the keys exp(theta). Raises _BudgetSpentError."""
        key = theta.tobytes()
        if key not in self.seen:
            if len(self.seen) >= self.budget:
                raise _BudgetSpentError
            self.seen[key] = (theta.copy(), *self._loop(np.exp(theta)))
        return self.seen[key][1:]

    def _loop(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        try:
            law = linear_law(self.build(values))
        except InputError:
            return WORST, np.array([-WORST])
        closed = closed_loop(self.plant, law)
        radius, points = spectral_radius(closed.A), frequency_points(self.sample_time)
        C = discrete_response(law[0, len(REFERENCE) :], self.grid)[:, 0]
        L = -np.einsum("nj,nj->n", C, self.G)
        crossover = float(abs(L[-1])) if "crossover" in self.bounds else 0.0
        n = points.size
        slack = bound_slack(self.bounds, points, L[:n], C[:n, MEASURED.index("position")], crossover, radius)
        if radius >= 1.0:
            return WORST, slack
        source = {"load": "extra", "reference": "r_position"}[self.tuning.response]
        samples = max(round(DURATION / self.sample_time), 100)
        position = unit_step(closed, INPUTS.index(source), [OUTPUTS.index("position")], samples)[:, 0]
        error = (1.0 if self.tuning.response == "reference" else 0.0) - position
        time = self.sample_time * np.arange(samples) if self.tuning.minimise == "ITAE" else 1.0
        total = abs(np.sum(error)) if self.tuning.minimise == "IE" else np.sum(time * np.abs(error))
        return float(np.log(max(self.sample_time * total, 1e-300))), slack

    def _slack(self, size: int, theta: np.ndarray) -> np.ndarray:
        return np.resize(self.evaluate(theta)[1], size)

    def rank(self, found: tuple[np.ndarray, float, np.ndarray]) -> tuple[float, float]:
        violation = max(-float(np.min(found[2])) - STRICTER, 0.0)
        return violation, found[1]

    @property
    def best(self) -> tuple[np.ndarray, float, np.ndarray]:
        return min(self.seen.values(), key=self.rank)

    def solve(self, start: np.ndarray | None) -> None:
        """Scatter, then search from the best few until the budget is spent."""
        from scipy.stats import qmc

        low, high = np.log(self.limits).T
        points = qmc.scale(qmc.Sobol(low.size, seed=0).random(SCATTERED), low, high)
        begin = [] if start is None else [np.clip(np.log(start), low, high)]
        for theta in [*begin, *points]:
            self.evaluate(theta)
        starts = sorted(self.seen.values(), key=self.rank)[:SEARCHES]
        # A share of the budget each: what one does not use is left to the next.
        whole, self.budget = self.budget, len(self.seen)
        for k, (theta, _, slack) in enumerate(starts):
            self.budget += (whole - self.budget) // (len(starts) - k)
            try:
                minimise(
                    lambda t: self.evaluate(t)[0],
                    theta,
                    list(zip(low, high, strict=True)),
                    # Keys that give no controller have one entry.
                    partial(self._slack, slack.size),
                    step=DIFFERENCE,
                )
            except _BudgetSpentError:
                continue


def tune_keys(
    build: Callable[[Mapping[str, float]], Any],
    limits: Mapping[str, tuple[float, float]],
    system: control.StateSpace,
    tuning: Tuning,
    *,
    sample_time: float,
    start: Mapping[str, float] | None = None,
    budget: int = BUDGET,
) -> TunedKeys:
    """Choose the values of keys with the least criterion within the bounds.

    Parameters
    ----------
    build: key -> SI value, to a controller with a linear law; raises InputError for values that give none.
    limits: key -> least and largest value, both greater than 0. start: values to begin with, besides scattered ones.
    system: continuous linear model as for `analyse_loop`. tuning: criterion and bounds; `terms` plays no part.
    budget: largest number of evaluations of the loop.

    Raises InputError without a key, and where no values satisfy the bounds, with the most that is violated.
    """
    names: Collection[str] = tuple(limits)
    if not names:
        raise InputError("there is no key left to tune; leave one of the tuned keys open")

    def made(values: np.ndarray) -> Any:
        return build(dict(zip(names, (float(value) for value in values), strict=True)))

    search = KeySearch(made, system, tuning, np.array([limits[name] for name in names]), sample_time, budget)
    search.solve(None if start is None or set(start) < set(names) else np.array([start[name] for name in names]))
    theta, criterion, slack = search.best
    if search.rank(search.best)[0] > 0.0:
        wanted = ", ".join(
            f"{name} {'at least' if name in LOWER_BOUNDS else 'at most'} {value:.4g}"
            for name, value in tuning.bounds().items()
        )
        nearest = ", ".join(f"{name} = {value:.4g}" for name, value in zip(names, np.exp(theta), strict=True))
        missed = "an unstable loop" if criterion >= WORST else f"{100 * -float(np.min(slack)):.3g} % beyond a bound"
        raise InputError(f"no values satisfy {wanted}; the nearest, {nearest}, are {missed}: relax the bounds")
    values = dict(zip(names, (float(value) for value in np.exp(theta)), strict=True))
    return TunedKeys(values, float(np.exp(criterion)), len(search.seen))
