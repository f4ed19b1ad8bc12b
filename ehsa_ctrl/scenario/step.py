"""Step metrics that are right for a plant that sticks.

Names are those of python-control's `step_info`; the rules differ where a real actuator breaks them: everything is
measured against the step (from the old target to the new one), crossings are interpolated, and what does not happen is
nan instead of an exception or a false success.
"""

from __future__ import annotations

import numpy as np

#: A loop has settled when it stays within this share of the step, or within this distance if that is more.
BAND, BAND_ABSOLUTE = 0.02, 100e-6


def step_metrics(time: np.ndarray, y: np.ndarray, before: float, target: float) -> dict[str, float]:
    """Step metrics of one response, from the moment of the step on.

    Parameters
    ----------
    time, y: (N,) s and the response; the first sample is at the step.
    before: what the response would be without the step (the old target), `target`: the new one.

    Returns
    -------
    RiseTime, SettlingTime, SettlingTimeAbs, SettlingMin, SettlingMax, Overshoot and Undershoot (as shares of the
    step), Peak, PeakTime, SteadyStateValue, SteadyStateError. nan for what does not happen.

    Undershoot is how far the response goes the wrong way before it has risen to 90 %, from where it starts: what was
    left of the error before the step is none, nor is a swing back later on.
    """
    size = target - before
    nothing = dict.fromkeys(
        ("RiseTime", "SettlingTime", "SettlingTimeAbs", "SettlingMin", "SettlingMax", "Overshoot", "Undershoot"), np.nan
    )
    tail = y[-max(y.size // 10, 1) :]
    peak = int(np.argmax(np.abs(y)))
    common = {
        "Peak": float(abs(y[peak])),
        "PeakTime": float(time[peak] - time[0]),
        "SteadyStateValue": float(np.mean(tail)),
        "SteadyStateError": float(abs(np.mean(tail) - target)),
    }
    if size == 0:
        return nothing | common
    share = (y - before) / size
    low, high = _first_crossing(time, share, 0.1), _first_crossing(time, share, 0.9)
    risen = y[time >= high] if np.isfinite(high) else np.array([np.nan])
    return common | {
        "RiseTime": float(high - low),
        "SettlingTime": _settling(time, share, settling_band(size)),
        "SettlingTimeAbs": _settling(time, share, BAND_ABSOLUTE / abs(size)),
        "SettlingMin": float(np.min(risen)),
        "SettlingMax": float(np.max(risen)),
        "Overshoot": float(max(np.max(share) - 1.0, 0.0)),
        "Undershoot": float(max(share[0] - np.min(share[: int(np.argmax(share >= 0.9)) or None]), 0.0)),
    }


def _first_crossing(time: np.ndarray, share: np.ndarray, level: float) -> float:
    """When `share` first reaches `level`, between samples by a line; nan if never."""
    reached = np.flatnonzero(share >= level)
    if reached.size == 0:
        return float("nan")
    k = int(reached[0])
    if k == 0:
        return float(time[0])
    return float(time[k - 1] + (level - share[k - 1]) / (share[k] - share[k - 1]) * (time[k] - time[k - 1]))


def settling_band(size: float) -> float:
    """Half width of the band in which a step of `size` [m] has settled, as a share of the step."""
    return max(BAND, BAND_ABSOLUTE / abs(size))


def _settling(time: np.ndarray, share: np.ndarray, band: float) -> float:
    """When `share` enters 1 +- band for good, between samples by a line; nan if never."""
    outside = np.flatnonzero(np.abs(share - 1.0) > band)
    if outside.size == 0:
        return 0.0
    k = int(outside[-1])
    if k == share.size - 1:
        return float("nan")
    edge = 1.0 + band * np.sign(share[k] - 1.0)
    return float(time[k] + (edge - share[k]) / (share[k + 1] - share[k]) * (time[k + 1] - time[k]) - time[0])
