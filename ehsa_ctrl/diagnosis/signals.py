"""The scored signals of a system, and the gap between measured and simulated ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..core.log import Log
from ..plant.system import ScoredSignal


def slope_samples(span: float, sample_time: float) -> int:
    """The whole number of samples nearest to a span [s], at least one."""
    return max(int(round(span / sample_time)), 1)


def slope(values: np.ndarray, span: float, sample_time: float) -> np.ndarray:
    """(x_k - x_(k-n)) / (n dt), (N,) or (..., N), with n dt nearest to span [s]; the first n samples are zero."""
    n = slope_samples(span, sample_time)
    out = np.zeros_like(values)
    out[..., n:] = (values[..., n:] - values[..., :-n]) / (n * sample_time)
    return out


def signal_of(signal: ScoredSignal, values: np.ndarray, sample_time: float) -> np.ndarray:
    """A scored signal (N,) from the values (N,) of its channel."""
    return slope(values, signal.span, sample_time) if signal.span else values


def scored(
    signals: Sequence[ScoredSignal], channels: Mapping[str, np.ndarray], sample_time: float
) -> dict[str, np.ndarray]:
    """Those of a system's scored signals that a log or a simulation has the channels of."""
    return {one.name: signal_of(one, channels[one.channel], sample_time) for one in signals if one.channel in channels}


def noise_of(log: Log) -> dict[str, float]:
    """Standard deviation of each channel's noise, from fourth differences.

    These leave little of a signal that the plant can produce. The steps of a converter hide small noise at standstill,
    so samples that equal their neighbours are left out.
    """
    return {name: _noise(values) for name, values in log.channels.items()}


def _noise(values: np.ndarray) -> float:
    fourth = np.diff(values, 4)
    still = np.lib.stride_tricks.sliding_window_view(np.diff(values) == 0.0, 4).all(axis=1)
    moving = np.abs(fourth[~still])
    if moving.size < 10:
        return 0.0
    return float(np.median(moving)) / 0.6745 / np.sqrt(70.0)


def signal_noise(signals: Sequence[ScoredSignal], noise: Mapping[str, float], sample_time: float) -> dict[str, float]:
    """Noise of the scored signals from that of the channels."""
    found = {}
    for one in signals:
        if one.channel in noise:
            sd = noise[one.channel]
            if one.span:
                sd = sd * np.sqrt(2.0) / (slope_samples(one.span, sample_time) * sample_time)
            found[one.name] = sd
    return found


def gap(
    measured: Mapping[str, np.ndarray], simulated: Mapping[str, np.ndarray], noise: Mapping[str, float]
) -> dict[str, float]:
    """Gap of each scored signal, and `total`, their RMS.

    RMS of measured minus simulated with the noise subtracted in quadrature, over the standard deviation of the measured
    signal. A constant signal has no gap. NaN in a simulation that stopped makes it infinite.
    """
    gaps = {}
    for name, values in measured.items():
        if name not in simulated:
            continue
        error = values - simulated[name]
        spread = float(np.std(values))
        if not np.isfinite(error).all():
            gaps[name] = float("inf")
        elif spread == 0.0:
            gaps[name] = 0.0
        else:
            gaps[name] = float(np.sqrt(max(np.mean(error**2) - noise[name] ** 2, 0.0))) / spread
    gaps["total"] = float(np.sqrt(np.mean([value**2 for value in gaps.values()])))
    return gaps


def largest(gaps: Mapping[str, float]) -> float:
    """The largest gap of a signal."""
    return max(value for name, value in gaps.items() if name != "total")
