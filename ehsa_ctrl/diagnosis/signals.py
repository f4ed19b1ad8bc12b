"""The scored signals, speed, both pressures and rod velocity, and the gap between measured and simulated ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.log import Log

#: The rod's velocity is the slope of its position over this time [s].
VELOCITY_SPAN = 0.02
#: The signals of a gap, in the order of tables.
SIGNALS = ("speed", "p1", "p2", "rod_velocity")


def velocity_samples(sample_time: float) -> int:
    """The whole number of samples nearest to VELOCITY_SPAN, at least one."""
    return max(int(round(VELOCITY_SPAN / sample_time)), 1)


def rod_velocity(position: np.ndarray, sample_time: float) -> np.ndarray:
    """(x_k - x_(k-n)) / (n dt) [m/s], (N,) or (..., N); the first n samples are zero."""
    n = velocity_samples(sample_time)
    out = np.zeros_like(position)
    out[..., n:] = (position[..., n:] - position[..., :-n]) / (n * sample_time)
    return out


def scored(channels: Mapping[str, np.ndarray], sample_time: float) -> dict[str, np.ndarray]:
    """The signals of a gap among the channels of a log or a simulation."""
    signals = {name: channels[name] for name in ("speed", "p1", "p2") if name in channels}
    if "position" in channels:
        signals["rod_velocity"] = rod_velocity(channels["position"], sample_time)
    return signals


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


def signal_noise(noise: Mapping[str, float], sample_time: float) -> dict[str, float]:
    """Noise of the scored signals from that of the channels."""
    out = {name: noise[name] for name in ("speed", "p1", "p2") if name in noise}
    if "position" in noise:
        out["rod_velocity"] = noise["position"] * np.sqrt(2.0) / (velocity_samples(sample_time) * sample_time)
    return out


def gap(
    measured: Mapping[str, np.ndarray], simulated: Mapping[str, np.ndarray], noise: Mapping[str, float]
) -> dict[str, float]:
    """Gap of each scored signal, and `total`, their RMS.

    RMS of measured minus simulated with the noise subtracted in quadrature, over the standard deviation of the measured
    signal. A constant signal has no gap. NaN in a simulation that stopped makes it infinite.
    """
    gaps = {}
    for name in SIGNALS:
        if name not in measured or name not in simulated:
            continue
        error = measured[name] - simulated[name]
        spread = float(np.std(measured[name]))
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
