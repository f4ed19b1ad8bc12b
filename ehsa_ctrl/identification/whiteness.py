"""Is anything left in the residuals that a better model could have explained?

A right model leaves residuals that don't know of each other, nor of the drive, the direction of motion or the
position. As in L. Ljung, "System Identification: Theory for the User", 2nd ed., section 16.6, on whitened residuals,
with friction's own regressors beside the input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal, stats

#: Lags in samples, and the probability with which a right model stays inside the band at each.
LAGS, LEVEL = 25, 0.99


@dataclass(frozen=True)
class Correlation:
    """Correlation of one channel's residual with something at lags 0 (1 for itself) to LAGS.

    values (lags,). band: what a right model stays within at 99 of 100 lags. white: at most the share of lags that
    chance alone puts outside, with a margin, is outside.
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
        """Not more lags outside than a right model has in 99 of 100 logs."""
        allowed = stats.binom.ppf(0.99, self.values.size, 1.0 - LEVEL)
        return bool(np.sum(np.abs(self.values) > self.band) <= allowed)


def correlations(
    white: np.ndarray, channels: tuple[str, ...], against: dict[str, np.ndarray]
) -> tuple[Correlation, ...]:
    """Residual tests of a run.

    white (N, m): whitened residual; channels: its columns; against: name -> (N,) what the residual must not know of.
    """
    samples = white.shape[0]
    lags = min(LAGS, samples // 4)
    band = float(stats.norm.ppf(0.5 + LEVEL / 2)) / np.sqrt(samples)
    out = []
    for column, channel in enumerate(channels):
        out.append(Correlation(channel, "itself", _correlate(white[:, column], white[:, column], lags)[1:], band))
        for name, values in against.items():
            if np.std(values) > 0.0:
                out.append(Correlation(channel, name, _correlate(white[:, column], values, lags), band))
    return tuple(out)


def _correlate(late: np.ndarray, early: np.ndarray, lags: int) -> np.ndarray:
    """Correlation of late[k + lag] with early[k], lag 0 to lags."""
    a, b = late - late.mean(), early - early.mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    if size == 0.0:
        return np.zeros(lags + 1)
    full = signal.correlate(a, b, method="fft")
    return full[a.size - 1 : a.size + lags] / size
