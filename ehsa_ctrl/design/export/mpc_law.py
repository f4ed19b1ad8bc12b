"""One sample of an MPC as text of the subset; what design/mpc.py does in Python, around a solver written in C."""

from __future__ import annotations

from math import isfinite

import numpy as np

from ..laws.mpc import _AGE, _GIVEN, _ITERATIONS, _PLAN, _REASON, _SHARE, _STATUS, PASSED
from ..laws.state_feedback import estimate, predict, regulator_current, target_current

#: Numbers before the feedback's settings.
HEAD = 15


def solve_qp(
    f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray, iterations: np.ndarray
) -> float:
    """Stands for the generated solver: x and y are where it starts and, if it returns 0, the solution; otherwise it
    returns a number of mpc.REASON. iterations[0]: how many there were.
    """
    raise NotImplementedError("the solver is written in C")


def motion_ahead(reference: np.ndarray, sample_time: float, horizon: int, motion: np.ndarray) -> None:
    """mpc_problem.ahead with the rows of its table one behind the other."""
    x, v, a = reference[0], reference[1], reference[2]
    motion[0], motion[1], motion[2] = x, v, a
    for i in range(1, horizon + 1):
        later = v + sample_time * a
        if v * a >= 0.0 or later * v <= 0.0:
            later = v if v * a >= 0.0 else 0.0
            a = 0.0
        x += 0.5 * sample_time * (v + later)
        v = later
        motion[3 * i], motion[3 * i + 1], motion[3 * i + 2] = x, v, a


def mpc_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of an MPC.

    settings: where the feedback's settings begin; length of its memory; current limit; largest change of the current
    in a sample (0: any); samples of the horizon; numbers of unknowns, of bounds, of states and disturbances, and of
    parameters; where shrink, F, T, lower, upper and root begin; then the feedback's settings, then these. They are
    those of mpc.prepare, but the solver's unknowns are z with theta = root z, and root' F stands for F.
    memory: the feedback's, then as in mpc.Mpc, then z and room for a sample's parameters, f and both bounds.
    """
    begin, behind, limit, change = int(settings[0]), int(settings[1]), settings[2], settings[3]
    horizon, unknowns, bounds, n, size = (
        int(settings[4]), int(settings[5]), int(settings[6]), int(settings[7]), int(settings[8])
    )  # fmt: skip
    shrink, F, T = int(settings[9]), int(settings[10]), int(settings[11])
    below, above, root = int(settings[12]), int(settings[13]), int(settings[14])
    feedback = settings[begin:]
    own = memory[behind:]
    solution = own[_PLAN:]
    multipliers = solution[unknowns:]
    z = multipliers[bounds:]
    p = z[unknowns:]
    f = p[size:]
    lower = f[unknowns:]
    upper = lower[bounds:]
    estimate(measured, memory, feedback, hold)
    known = target_current(reference[0], reference[1], reference[2], memory, feedback)
    for i in range(n):
        p[i] = memory[4 + n + i] * settings[shrink + i]
    motion_ahead(reference, feedback[4], horizon, p[n:])
    p[size - 4], p[size - 3], p[size - 2], p[size - 1] = memory[2], extra, own[_GIVEN], 1.0
    for i in range(unknowns):
        total = 0.0
        for k in range(size):
            total += settings[F + i * size + k] * p[k]
        f[i] = total
    for i in range(bounds):
        shift = 0.0
        for k in range(size):
            shift += settings[T + i * size + k] * p[k]
        lower[i] = settings[below + i] + shift
        upper[i] = settings[above + i] + shift
    own[_REASON] = solve_qp(f, lower, upper, z, multipliers, own[_ITERATIONS:])
    if own[_REASON] == 0.0:
        for i in range(unknowns):
            entry = 0.0
            for k in range(unknowns):
                entry += settings[root + i * unknowns + k] * z[k]
            solution[i] = entry
        share = 0.0
        for i in range(horizon, unknowns):
            share = max(share, solution[i])
        own[_SHARE], own[_STATUS], own[_AGE] = share, 1.0 if share > PASSED else 0.0, 0.0
        wanted = solution[0] + known
    else:
        # A start from what did not end well would spoil the samples after it.
        for i in range(bounds):
            multipliers[i] = 0.0
        own[_SHARE] = 0.0
        own[_AGE] += 1.0
        if own[_AGE] == 1.0:
            own[_STATUS] = 2.0
            wanted = solution[1] + known
        else:
            own[_STATUS] = 3.0
            wanted = regulator_current(reference[0], reference[1], reference[2], memory, feedback)
        if not isfinite(wanted):
            wanted = -extra
        bridged = min(max(wanted + extra, -limit), limit)
        if change > 0.0:
            bridged = min(max(bridged, own[_GIVEN] - change), own[_GIVEN] + change)
        wanted = bridged - extra
    given = min(max(wanted + extra, -limit), limit)
    own[_GIVEN] = given
    predict(given - extra, known, memory, feedback)
    return given


USES = (target_current, regulator_current, estimate, predict, motion_ahead)
