"""The gap of a model: RMS error beyond the noise over the standard deviation of each signal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

SIGNALS = ("speed", "p1", "p2", "rod_velocity")
STRIDE = 5  # samples of 4 ms: the rod velocity is taken over 20 ms


def signals(speed: np.ndarray, p1: np.ndarray, p2: np.ndarray, position: np.ndarray) -> dict[str, np.ndarray]:
    velocity = (position[STRIDE:] - position[:-STRIDE]) / (0.004 * STRIDE)
    return {"speed": speed, "p1": p1, "p2": p2, "rod_velocity": velocity}


def of_samples(samples: np.ndarray) -> dict[str, np.ndarray]:
    """Signals of the (N, 5) samples of a run: speed, p1, p2, position, force."""
    return signals(*samples[:, :4].T)


def noise_of(sd: Mapping[str, float], step: Mapping[str, float]) -> dict[str, float]:
    """Noise of the four signals from that of the channels; a converter's steps count as uniform noise."""
    channel = {
        name: float(np.hypot(sd[name], step.get(name, 0.0) / np.sqrt(12.0)))
        for name in ("speed", "p1", "p2", "position")
    }
    velocity = np.sqrt(2.0) * channel.pop("position") / (0.004 * STRIDE)
    return {**channel, "rod_velocity": float(velocity)}


def gap(
    measured: Mapping[str, np.ndarray],
    simulated: Mapping[str, np.ndarray],
    noise: Mapping[str, float] | None = None,
    window: slice = slice(None),
) -> dict[str, float]:
    """RMS difference minus the noise in quadrature, over the measured standard deviation; `total` is the RMS of all."""
    out = {}
    for name in SIGNALS:
        y, difference = measured[name][window], (measured[name] - simulated[name])[window]
        square = np.mean(difference**2) - (noise[name] ** 2 if noise else 0.0)
        out[name] = float(np.sqrt(max(square, 0.0)) / max(np.std(y), 1e-12))
    out["total"] = float(np.sqrt(np.mean([out[name] ** 2 for name in SIGNALS])))
    return out


def largest(values: Mapping[str, float]) -> float:
    return max(values[name] for name in SIGNALS)
