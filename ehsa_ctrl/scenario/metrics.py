"""How a closed loop did, in numbers that are right for a plant that sticks.

Names of the step metrics are those of python-control's `step_info`; the rules differ where a real actuator breaks
them: everything is measured against the step (from the old target to the new one), crossings are interpolated, and
what does not happen is nan instead of an exception or a false success.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..simulation.closed_loop import ClosedLoop

#: A loop has settled when it stays within this share of the step, or within this distance if that is more.
BAND, BAND_ABSOLUTE = 0.02, 100e-6
#: Hunting is looked for in this last share of the time after the last change of target.
HUNTING_SHARE = 0.5


@dataclass(frozen=True)
class Metric:
    """What a number is: its SI unit, the unit a person reads, and a line of explanation."""

    unit: str
    shown: str
    meaning: str


METRICS = {
    "RiseTime": Metric("s", "ms", "from 10 to 90 % of the step, the slowest step"),
    "SettlingTime": Metric(
        "s", "ms", "until the position stays within 2 % of the step (at least 0.1 mm), slowest step"
    ),
    "Overshoot": Metric("1", "%", "beyond the target, in % of the step, worst step"),
    "Undershoot": Metric("1", "%", "the wrong way at first, in % of the step, worst step"),
    "Peak": Metric("m", "mm", "largest distance from zero"),
    "PeakTime": Metric("s", "s", "when that is"),
    "SteadyStateError": Metric("m", "um", "mean error in the last tenth before the next change, worst step"),
    "MaxError": Metric("m", "mm", "largest error, after the first change of target"),
    "RMSError": Metric("m", "mm", "root mean square of the error, whole run"),
    "IAE": Metric("m s", "mm s", "integral of |e|"),
    "ITAE": Metric("m s2", "mm s2", "integral of t |e|"),
    "HuntingAmplitude": Metric("m", "um", "peak to peak while holding the last target, if it hunts"),
    "HuntingPeriod": Metric("s", "s", "of that"),
    "Slips": Metric("1", "1", "times the rod breaks away while it should hold the last target"),
    "StickShare": Metric("1", "%", "share of the run in which the rod sticks"),
    "SaturationShare": Metric("1", "%", "share of the run with the current at its limit"),
    "CurrentRMS": Metric("A", "A", "root mean square of the current"),
    "TV": Metric("A", "A", "total variation of the current"),
    "Energy": Metric("J", "J", "shaft work taken from the motor, positive part"),
}


def step_metrics(time: np.ndarray, y: np.ndarray, before: float, target: float) -> dict[str, float]:
    """Step metrics of one response, from the moment of the step on.

    Parameters
    ----------
    time, y: (N,) s and the response; the first sample is at the step.
    before: what the response would be without the step (the old target), `target`: the new one.

    Returns
    -------
    RiseTime, SettlingTime, SettlingMin, SettlingMax, Overshoot and Undershoot (as shares of the step), Peak,
    PeakTime, SteadyStateValue, SteadyStateError. nan for what does not happen.
    """
    size = target - before
    nothing = dict.fromkeys(
        ("RiseTime", "SettlingTime", "SettlingMin", "SettlingMax", "Overshoot", "Undershoot"), np.nan
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
    band = max(BAND, BAND_ABSOLUTE / abs(size))
    outside = np.flatnonzero(np.abs(share - 1.0) > band)
    if outside.size == 0:
        settling = 0.0
    elif outside[-1] == y.size - 1:
        settling = np.nan
    else:
        k = outside[-1]
        edge = 1.0 + band * np.sign(share[k] - 1.0)
        settling = time[k] + (edge - share[k]) / (share[k + 1] - share[k]) * (time[k + 1] - time[k]) - time[0]
    risen = y[time >= high] if np.isfinite(high) else np.array([np.nan])
    return common | {
        "RiseTime": float(high - low),
        "SettlingTime": float(settling),
        "SettlingMin": float(np.min(risen)),
        "SettlingMax": float(np.max(risen)),
        "Overshoot": float(max(np.max(share) - 1.0, 0.0)),
        "Undershoot": float(max(-np.min(share), 0.0)),
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


def hunting(time: np.ndarray, x: np.ndarray, rod: np.ndarray) -> dict[str, float]:
    """Stick-slip around a target that should be held.

    Parameters
    ----------
    time, x: (N,) of the hold; rod: (N,) sliding direction, 0 while it sticks.

    Returns
    -------
    Slips: how often the rod breaks away. HuntingAmplitude (peak to peak) and HuntingPeriod: of the motion, if it slips
    both ways; 0 and nan otherwise.
    """
    if not np.any(rod):
        # Nothing slips, or friction without sticking, whose contact has no direction.
        return {"Slips": 0.0, "HuntingAmplitude": 0.0, "HuntingPeriod": float("nan")}
    starts = np.flatnonzero((rod[1:] != 0) & (rod[:-1] != rod[1:])) + 1
    ways = rod[starts]
    turns = starts[1:][ways[1:] != ways[:-1]]
    if turns.size == 0:
        return {"Slips": float(starts.size), "HuntingAmplitude": 0.0, "HuntingPeriod": float("nan")}
    period = 2 * float(np.mean(np.diff(time[turns]))) if turns.size > 1 else float("nan")
    return {"Slips": float(starts.size), "HuntingAmplitude": float(np.ptp(x)), "HuntingPeriod": period}


def loop_metrics(
    loop: ClosedLoop, *, jumps: Sequence[float], holds: Sequence[float], current_limit: float
) -> dict[str, float]:
    """All of METRICS for a run.

    Parameters
    ----------
    jumps: times at which the target jumps; step metrics are the worst over them, nan if there is none.
    holds: times from which on something is to be held until the next such time: a target reached, a force come or
        gone. The standing error is the worst over them; hunting is looked for in the last one.
    current_limit: of the controller, A.
    """
    run = loop.trajectory
    time, x, error, target = run.time, run["x"], loop.error, loop.reference[:, 0]
    dt = float(time[1] - time[0])
    result = dict.fromkeys(METRICS, float("nan"))
    steps = []
    for part in _parts(time, jumps):
        first = int(part[0])
        before = float(target[first - 1]) if first else 0.0
        steps.append(step_metrics(time[part], x[part], before, float(target[first])))
    for name in ("RiseTime", "SettlingTime", "Overshoot", "Undershoot"):
        if steps:
            # A step that never settles is worse than any that does: nan must win over numbers.
            result[name] = float(np.max(np.array([step[name] for step in steps])))
    held = _parts(time, holds)
    if held:
        result["SteadyStateError"] = max(float(abs(np.mean(error[part[-max(part.size // 10, 1) :]]))) for part in held)
        last = held[-1]
        last = last[time[last] >= time[last[0]] + (1 - HUNTING_SHARE) * (time[-1] - time[last[0]])]
        result |= hunting(time[last], x[last], run.modes[last, 1])
    begun = time >= (min([*jumps, *holds]) if jumps or holds else time[0])
    peak = int(np.argmax(np.abs(x)))
    power = run.plant["K_T"] * run.current * run["omega"]
    return result | {
        "Peak": float(abs(x[peak])),
        "PeakTime": float(time[peak]),
        "MaxError": float(np.max(np.abs(error[begun]), initial=0.0)),
        "RMSError": float(np.sqrt(np.mean(error**2))),
        "IAE": float(np.sum(np.abs(error)) * dt),
        "ITAE": float(np.sum(time * np.abs(error)) * dt),
        "StickShare": float(np.mean(run.sticks("rod"))),
        "SaturationShare": float(np.mean(np.abs(loop.asked) >= current_limit * (1 - 1e-9))),
        "CurrentRMS": float(np.sqrt(np.mean(run.current**2))),
        "TV": float(np.sum(np.abs(np.diff(loop.asked)))),
        "Energy": float(np.sum(np.maximum(power, 0.0)) * dt),
    }


def _parts(time: np.ndarray, starts: Sequence[float]) -> list[np.ndarray]:
    """Indices of the samples from each start to the next; parts of fewer than three samples are left out."""
    edges = [*sorted(set(starts)), np.inf]
    parts = [
        np.flatnonzero((time >= start - 1e-9) & (time < end - 1e-9))
        for start, end in zip(edges[:-1], edges[1:], strict=True)
    ]
    return [part for part in parts if part.size > 2]
