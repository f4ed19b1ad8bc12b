"""Stick-slip around a target that should be held.

A PID on a plant whose static friction lies above its Coulomb friction has a limit cycle (B. Armstrong, B. Amin, "PID
control in the presence of static friction", Automatica 32(5), 1996), and the describing function predicts it badly:
so it is measured.
"""

from __future__ import annotations

import numpy as np


def hunting(time: np.ndarray, x: np.ndarray) -> dict[str, float]:
    """Hunting of a contact that truly sticks: where x does not change to the last bit, it sticks.

    Looking at x instead of at the sampled sliding direction finds a slip that begins and ends between two samples.

    Parameters
    ----------
    time, x: (N,) of the hold.

    Returns
    -------
    Slips: how often the rod breaks away or turns round. HuntingAmplitude (peak to peak) and HuntingPeriod: of the
    motion, if it goes both ways; 0 and nan otherwise. One turn is taken for hunting, as a slow cycle may show no more
    in the time there is; its period is nan then.
    """
    way = np.sign(np.diff(x))
    starts = np.flatnonzero((way != 0) & (np.concatenate([[0.0], way[:-1]]) != way))
    ways = way[starts]
    turns = starts[1:][ways[1:] != ways[:-1]]
    if turns.size == 0:
        return {"Slips": float(starts.size), "HuntingAmplitude": 0.0, "HuntingPeriod": float("nan")}
    period = 2 * float(np.mean(np.diff(time[turns]))) if turns.size > 1 else float("nan")
    return {"Slips": float(starts.size), "HuntingAmplitude": float(np.ptp(x)), "HuntingPeriod": period}
