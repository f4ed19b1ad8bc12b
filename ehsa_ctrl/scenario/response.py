"""Metrics of one response of a plant with friction: step response, and stick-slip around a constant target.

The names are those of python-control's `step_info`. The rules differ where those assume an ideal response: a step runs
from the old target to the new one, crossings are interpolated between samples, and an event that does not happen gives
nan instead of an exception or a false success.
"""

from __future__ import annotations

import numpy as np

from ..core.errors import InputError

#: A loop has settled when it stays within this share of the step (the usual 2 %), or within this distance [m] if that
#: is larger: about the accuracy to which a PID without friction compensation holds the EHSA (docs/limits.md).
BAND, BAND_ABSOLUTE = 0.02, 100e-6


def step_metrics(
    time: np.ndarray, y: np.ndarray, before: float, target: float, absolute: float = BAND_ABSOLUTE
) -> dict[str, float]:
    """Step metrics of one response; nan for an event that does not happen.

    Parameters
    ----------
    time, y: (N,) times [s] and response [m]; the first sample is at the step.
    before, target: old and new target [m].
    absolute: least half width of the settling band [m].

    Returns
    -------
    RiseTime, SettlingTime, SettlingTimeAbs, SettlingMin, SettlingMax, Overshoot and Undershoot (as shares of the
    step), Peak, PeakTime, SteadyStateValue, SteadyStateError.

    Undershoot is the largest motion in the wrong direction, relative to the initial value, before the response reaches
    90 %. An error that remains from before the step and a later oscillation do not count.
    """
    size = target - before
    tail = y[-max(y.size // 10, 1) :]
    peak = int(np.argmax(np.abs(y)))
    common = {
        "Peak": float(abs(y[peak])),
        "PeakTime": float(time[peak] - time[0]),
        "SteadyStateValue": float(np.mean(tail)),
        "SteadyStateError": float(abs(np.mean(tail) - target)),
    }
    if size == 0:
        names = "RiseTime", "SettlingTime", "SettlingTimeAbs", "SettlingMin", "SettlingMax", "Overshoot", "Undershoot"
        return dict.fromkeys(names, np.nan) | common
    share = (y - before) / size
    low, high = _first_crossing(time, share, 0.1), _first_crossing(time, share, 0.9)
    risen = y[time >= high] if np.isfinite(high) else np.array([np.nan])
    return common | {
        "RiseTime": float(high - low),
        "SettlingTime": _settling(time, share, settling_band(size, absolute)),
        "SettlingTimeAbs": _settling(time, share, absolute / abs(size)),
        "SettlingMin": float(np.min(risen)),
        "SettlingMax": float(np.max(risen)),
        "Overshoot": float(max(np.max(share) - 1.0, 0.0)),
        "Undershoot": float(max(share[0] - np.min(share[: int(np.argmax(share >= 0.9)) or None]), 0.0)),
    }


def settling_band(size: float, absolute: float = BAND_ABSOLUTE) -> float:
    """Half width of the settling band of a step of `size` [m], as a share of the step; `absolute` [m] at least."""
    return max(BAND, absolute / abs(size))


def hunting(time: np.ndarray, x: np.ndarray) -> dict[str, float]:
    """Stick-slip limit cycle around a constant target.

    A PID on a plant whose static friction exceeds its Coulomb friction has a limit cycle (B. Armstrong, B. Amin, "PID
    control in the presence of static friction", Automatica 32(5), 1996). The describing function predicts it poorly,
    so this function measures it. A sticking rod keeps x to the last bit; comparing x instead of the sampled sliding
    direction also finds a slip between two samples.

    Parameters
    ----------
    time, x: (N,) times [s] and rod position [m] during the hold.

    Returns
    -------
    Slips: number of breakaways and reversals. HuntingAmplitude (peak to peak [m]; 0 without a reversal) and
    HuntingPeriod ([s]; nan with fewer than two reversals).

    Raises InputError for vectors of different lengths.
    """
    if time.ndim != 1 or time.shape != x.shape or time.size < 2:
        raise InputError(
            f"hunting: time has shape {time.shape} and x {x.shape}; expected two vectors of equal length, two samples "
            "or more"
        )
    direction = np.sign(np.diff(x))
    starts = np.flatnonzero((direction != 0) & (np.concatenate([[0.0], direction[:-1]]) != direction))
    directions = direction[starts]
    reversals = starts[1:][directions[1:] != directions[:-1]]
    if reversals.size == 0:
        return {"Slips": float(starts.size), "HuntingAmplitude": 0.0, "HuntingPeriod": float("nan")}
    period = 2 * float(np.mean(np.diff(time[reversals]))) if reversals.size > 1 else float("nan")
    return {"Slips": float(starts.size), "HuntingAmplitude": float(np.ptp(x)), "HuntingPeriod": period}


def _first_crossing(time: np.ndarray, share: np.ndarray, level: float) -> float:
    """Time [s] at which `share` (N,) first reaches `level`, interpolated linearly; nan if never."""
    reached = np.flatnonzero(share >= level)
    if reached.size == 0:
        return float("nan")
    k = int(reached[0])
    if k == 0:
        return float(time[0])
    return float(time[k - 1] + (level - share[k - 1]) / (share[k] - share[k - 1]) * (time[k] - time[k - 1]))


def _settling(time: np.ndarray, share: np.ndarray, band: float) -> float:
    """Time [s] from which `share` (N,) stays within 1 +- band, interpolated linearly; nan if never."""
    outside = np.flatnonzero(np.abs(share - 1.0) > band)
    if outside.size == 0:
        return 0.0
    k = int(outside[-1])
    if k == share.size - 1:
        return float("nan")
    edge = 1.0 + band * np.sign(share[k] - 1.0)
    return float(time[k] + (edge - share[k]) / (share[k + 1] - share[k]) * (time[k + 1] - time[k]) - time[0])
