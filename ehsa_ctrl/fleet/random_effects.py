"""Parameters of a fleet: its mean, and how much its units differ (a linear mixed model with random units).

    a_r ~ N(mean, diag(spread^2))        unit r of the fleet
    -2 log p(logs of r | a) = constant - 2 g_r' a + a' H_r a

Restricted maximum likelihood by the EM algorithm: N. M. Laird, J. H. Ware, "Random-effects models for longitudinal
data", Biometrics 38 (1982). The mean is integrated out together with the units, so that its estimation does not bias
the spread.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

#: Iterations at most, and the relative change of the spread that ends them. EM converges slowly towards a spread of 0.
ITERATIONS, CONVERGED = 2000, 1e-5
#: Smallest spread, in units of x: below it a spread counts as none.
LEAST = 1e-4
#: Units that are computed at once, so that a large fleet needs little memory.
BLOCK = 1000


@dataclass(frozen=True)
class RandomEffects:
    """The fleet and its units.

    mean (k,), mean_sd (k,): of the fleet. spread (k,): standard deviation between units.
    units (R, k): of each unit, given the fleet (empirical Bayes).
    determined (k,): units' worth of information on each parameter: 1 per unit that determines it far better than the
        spread, 0 per unit whose logs say nothing.
    """

    mean: np.ndarray
    mean_sd: np.ndarray
    spread: np.ndarray
    units: np.ndarray
    determined: np.ndarray


def random_effects(score: np.ndarray, information: np.ndarray, start: np.ndarray | float = 1.0) -> RandomEffects:
    """Mean and spread from the score g_r (R, k) and information H_r (R, k, k) of each unit.

    start: (k,) or one number, the spread at which the iteration starts; it must not be 0.
    """
    k = score.shape[1]
    variance = np.full(k, 1.0) * np.asarray(start, dtype=float) ** 2
    for _ in range(ITERATIONS):
        mean, of_mean, found, covariance = _posterior(score, information, variance)
        total = np.mean((found - mean) ** 2 + covariance, axis=0)
        changed = np.max(np.abs(total - variance) / np.maximum(variance, LEAST**2))
        variance = np.maximum(total, LEAST**2)
        if changed < CONVERGED:
            break
    mean, of_mean, found, covariance = _posterior(score, information, variance)
    own = _own_covariance(information, variance)
    return RandomEffects(
        mean=mean,
        mean_sd=np.sqrt(of_mean),
        spread=np.where(variance <= 1.01 * LEAST**2, 0.0, np.sqrt(variance)),
        units=found,
        determined=np.sum(np.maximum(1.0 - np.einsum("rii->ri", own) / variance, 0.0), axis=0),
    )


def _own_covariance(information: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Covariance (R, k, k) of each unit given the fleet's mean: (H_r + T^-1)^-1."""
    # In units of the spread, so that a spread near zero is harmless.
    root = np.sqrt(variance)
    found = np.empty_like(information)
    for part in _blocks(len(information)):
        scaled = information[part] * root[:, None] * root
        found[part] = np.linalg.inv(scaled + np.eye(variance.size)) * root[:, None] * root
    return found


def _blocks(units: int) -> Iterator[slice]:
    return (slice(first, first + BLOCK) for first in range(0, units, BLOCK))


def _posterior(
    score: np.ndarray, information: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean (k,) with its variance (k,), units (R, k), and variance of unit minus mean (R, k), given the spread."""
    own = _own_covariance(information, variance)
    k = variance.size
    total, right = np.zeros((k, k)), np.zeros(k)
    for part in _blocks(len(own)):
        # V_r = (H_r + T^-1)^-1 and I - V_r H_r = V_r T^-1: what is left of the mean in a unit's estimate.
        left = own[part] / variance
        # The information of unit r on the mean: H_r - H_r V_r H_r = H_r V_r T^-1.
        on_mean = information[part] @ left
        total += np.sum((on_mean + on_mean.transpose(0, 2, 1)) / 2.0, axis=0)
        right += np.einsum("rij,ri->j", left, score[part])
    size = np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size)
    mean = inverse @ right
    units, of_difference = np.empty_like(score), np.empty_like(score)
    for part in _blocks(len(own)):
        left = own[part] / variance
        units[part] = np.einsum("rij,rj->ri", own[part], score[part]) + left @ mean
        # Unit minus mean also moves with the mean's own error.
        moves = left - np.eye(k)
        of_difference[part] = np.einsum("rii->ri", own[part]) + np.einsum("rij,rij->ri", moves @ inverse, moves)
    return mean, np.diag(inverse).copy(), units, of_difference
