"""Correlation tests of whitened residuals: is anything left that a better model could explain?

The residuals of a right model are uncorrelated with their own past, with the input, the direction of motion and the
position. Source: L. Ljung, "System Identification: Theory for the User", 2nd ed., section 16.6, with the regressors of
friction beside the input.

Lags are not independent: sign(v) keeps its value for many samples, so that all of its lags show nearly the same. The
bands hold for all tests of a run together: one of 100 right models fails one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import optimize, stats

#: Lags in samples, and the probability with which a right model stays inside all bands of a run.
LAGS, LEVEL = 25, 0.99


@dataclass(frozen=True)
class Correlation:
    """Correlation of one channel's residual with a signal at lags 0 (1 for itself) to LAGS.

    values (lags,). band: limit that a right model exceeds at no lag and in no test of the run, for 99 of 100 logs.
    """

    channel: str
    against: str
    values: np.ndarray
    band: float

    @property
    def outside(self) -> float:
        """Share of lags outside the band."""
        return float(np.mean(np.abs(self.values) > self.band))

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.values)))

    @property
    def passed(self) -> bool:
        """Whether no lag is outside."""
        return bool(self.largest <= self.band)


def correlations(
    white: np.ndarray, channels: tuple[str, ...], against: Mapping[str, np.ndarray]
) -> tuple[Correlation, ...]:
    """Residual tests of a run.

    white (N, m): whitened residual with the columns `channels`; against: name -> (N,) signal that the residual has to
    be uncorrelated with.
    """
    samples = white.shape[0]
    lags = min(LAGS, samples // 4)
    moving = {name: values for name, values in against.items() if np.std(values) > 0.0}
    alarm = (1.0 - LEVEL) / (len(channels) * (1 + len(moving)))
    size = np.sqrt(samples)
    own_band = band(0.0, lags, alarm) / size
    bands = {name: band(_correlate(values, values, 1)[1], lags + 1, alarm) / size for name, values in moving.items()}
    out = []
    for residual, channel in zip(white.T, channels, strict=True):
        out.append(Correlation(channel, "itself", _correlate(residual, residual, lags)[1:], own_band))
        for name, values in moving.items():
            out.append(Correlation(channel, name, _correlate(residual, values, lags), bands[name]))
    return tuple(out)


@cache
def band(neighbours: float, lags: int, alarm: float) -> float:
    """Level that the largest magnitude of `lags` standard normal numbers exceeds with probability `alarm` at most.

    neighbours: correlation of each number with the next. By the bound P(any) <= sum P(each) - sum P(each and the next)
    of K. J. Worsley, Biometrika 69(2), 1982; for independent numbers it is nearly Bonferroni's.
    """
    rho = float(np.clip(abs(neighbours), 0.0, 1.0 - 1e-9))
    pair = stats.multivariate_normal(cov=[[1.0, rho], [rho, 1.0]])
    mirrored = stats.multivariate_normal(cov=[[1.0, -rho], [-rho, 1.0]])

    def excess(level: float) -> float:
        each = 2.0 * stats.norm.sf(level)
        both = 2.0 * (pair.cdf([-level, -level]) + mirrored.cdf([-level, -level]))
        return float(lags * each - (lags - 1) * both - alarm)

    return float(optimize.brentq(excess, stats.norm.isf(alarm / 2.0) - 1e-6, stats.norm.isf(alarm / 2.0 / lags) + 1e-6))


def _correlate(late: np.ndarray, early: np.ndarray, lags: int) -> np.ndarray:
    """Correlation of late[k + lag] with early[k], lag 0 to lags."""
    a, b = late - late.mean(), early - early.mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    if size == 0.0:
        return np.zeros(lags + 1)
    return np.array([a[lag:] @ b[: b.size - lag] for lag in range(lags + 1)]) / size
