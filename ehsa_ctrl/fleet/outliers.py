"""Rigs that differ from their fleet from their first log on: what they had before anybody looked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from .changes import Names, RigScores
from .null import ENOUGH_RIGS, largest_null
from .random_effects import RandomEffects

#: Prior variance of what is compared with the fleet, in units of the names: practically none.
NO_PRIOR = 1e6


@dataclass(frozen=True)
class Outlier:
    """How a rig differs most from the fleet. p: probability of a larger difference by chance, for all causes.

    size (m,): in units of the names, relative to the fleet's median.
    """

    rig: str
    cause: str
    p: float
    size: np.ndarray


def outliers(rigs: Iterable[RigScores], names: Names, fleet: RandomEffects) -> list[Outlier | None]:
    """The largest difference of each rig; None for all in a fleet of fewer than ENOUGH_RIGS rigs.

    rigs: their logs before any change, one by one. fleet: of the plant's parameters, whose spread is the prior of a
    unit.
    """
    rig_names, values, variances = [], [], []
    for rig in rigs:
        H, g = rig.total, rig.score.sum(axis=0)
        found = [_estimate(H, g, names.nominal, own, fleet) for own in names.causes.values()]
        rig_names.append(rig.name)
        # An array a rig: thousands of small ones would take most of the memory.
        values.append(np.concatenate([value for value, _ in found]))
        variances.append(np.concatenate([variance for _, variance in found]))
    if len(rig_names) < ENOUGH_RIGS:
        return [None] * len(rig_names)
    statistic = np.zeros((len(rig_names), len(names.causes)))
    parameters = np.zeros(len(names.causes))
    sizes: list[np.ndarray] = []
    every = [np.array(values), np.array(variances)]
    ends = np.cumsum([len(own) for own in names.causes.values()]).tolist()
    for column, (own, end) in enumerate(zip(names.causes.values(), ends, strict=True)):
        value, variance = (one[:, end - len(own) : end] for one in every)
        known = np.isfinite(variance)
        parameters[column] = np.any(known.sum(axis=0) >= ENOUGH_RIGS)
        difference = np.zeros_like(value)
        for i in range(len(own)):
            seen = known[:, i]
            if seen.sum() < ENOUGH_RIGS:
                continue
            difference[seen, i] = value[seen, i] - np.median(value[seen, i])
            spread = robust_variance(difference[seen, i], variance[seen, i])
            # The largest of several, so that a cause with many parameters is not favoured.
            one = difference[seen, i] ** 2 / (variance[seen, i] + spread)
            statistic[seen, column] = np.maximum(statistic[seen, column], one)
        sizes.append(difference)
    if not parameters.any():
        return [None] * len(rig_names)
    null = largest_null([row[:, None] for row in statistic], parameters)
    listed, relative = list(names.causes), statistic / null.factor
    relative[:, parameters == 0] = -1.0
    best = np.argmax(relative, axis=1)
    return [
        Outlier(name, listed[best[i]], null.p(statistic[i][:, None]), sizes[best[i]][i])
        for i, name in enumerate(rig_names)
    ]


def _estimate(
    H: np.ndarray, g: np.ndarray, n: int, own: np.ndarray, fleet: RandomEffects
) -> tuple[np.ndarray, np.ndarray]:
    """Deviation (m,) of a cause's parameters from nominal, and variance (m,), infinite where the logs say nothing.

    H (k, k), g (k,): information and score of a rig. n: number of parameters of the plant. own (m,): of the cause.
    """
    free = np.concatenate([np.arange(n), own[own >= n]])
    prior = np.full(free.size, 1.0 / NO_PRIOR)
    mean = np.zeros(free.size)
    others = ~np.isin(np.arange(n), own)
    spread = np.maximum(fleet.spread[others], 1e-3)
    prior[:n][others], mean[:n][others] = 1.0 / spread**2, fleet.mean[others]
    inverse = np.linalg.inv(H[np.ix_(free, free)] + np.diag(prior))
    x = inverse @ (g[free] + prior * mean)
    place = np.array([int(np.flatnonzero(free == i)[0]) for i in own])
    variance = np.diag(inverse)[place]
    return x[place], np.where(variance < 0.5 * NO_PRIOR, variance, np.inf)


def robust_variance(difference: np.ndarray, variance: np.ndarray) -> float:
    """Variance between units such that the median of d^2 / (variance + it) is that of a chi-squared variable.

    The estimate of R. C. Paule, J. Mandel, J. Res. Natl. Bur. Stand. 87 (1982), with the median for the mean, so that
    single outliers do not move it.
    """
    expected = float(stats.chi2.median(1.0))

    def excess(between: float) -> float:
        return float(np.median(difference**2 / (variance + between))) - expected

    if excess(0.0) <= 0.0:
        return 0.0
    return float(brentq(excess, 0.0, float(np.max(difference**2)) / expected))
