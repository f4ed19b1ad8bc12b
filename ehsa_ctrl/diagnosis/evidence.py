"""How much a difference in cost is worth: residuals that hang together count less than independent ones."""

from __future__ import annotations

import numpy as np

from .fit import Refit

#: Bounds of what one residual counts, in independent ones.
LEAST, MOST = 0.001, 0.5
#: See `deviations`.
WIDER = 4.0
#: Autocorrelation is followed for this long [s].
MEMORY = 1.0


def worth(parts: np.ndarray, sample_time: float) -> np.ndarray:
    """What one squared residual of each channel counts, (channels,), from those of the best model (channels, n).

    1 / (mean square * (1 + 2 sum of autocorrelations)), the sum cut where it first turns negative: the number of
    independent residuals among correlated ones (M. B. Priestley, "Spectral Analysis and Time Series", 1981, 5.3.2).
    """
    lags = max(int(MEMORY / sample_time), 1)
    out = np.empty(len(parts))
    for c, part in enumerate(parts):
        square = max(float(np.mean(part**2)), 1e-12)
        n = part.size
        correlation = np.fft.irfft(np.abs(np.fft.rfft(part, 2 * n)) ** 2)[: min(lags, n)] / (n * square)
        negative = np.flatnonzero(correlation < 0.0)
        correlation = correlation[: int(negative[0]) if negative.size else None]
        out[c] = 1.0 / (square * (1.0 + 2.0 * float(np.sum(correlation[1:]))))
    return np.clip(out, LEAST, MOST)


def deviations(fit: Refit, worth: np.ndarray) -> dict[str, float]:
    """Standard deviation of each number of the suspects.

    The nominal parameters are free under priors that are WIDER than those of the fit: what they are held at goes into
    the numbers, and a modeller may be more wrong than is usual.
    """
    own, k = fit.own, len(fit.frees)
    weight = np.repeat(worth, fit.residual.size // worth.size)
    information = fit.jacobian.T @ (weight[:, None] * fit.jacobian)
    information[np.arange(own, k), np.arange(own, k)] += 1.0 / WIDER**2
    size = np.sqrt(np.maximum(np.diag(information), 1e-12))
    covariance = np.linalg.pinv(information / np.outer(size, size), rcond=1e-10) / np.outer(size, size)
    return {f.name: float(np.sqrt(max(covariance[i, i], 0.0))) * f.scale for i, f in enumerate(fit.frees[:own])}
