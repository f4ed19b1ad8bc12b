"""A dual active-set method for the solver in exported code, in the subset of Python that becomes C.

    minimise z' z / 2 + f' z    subject to    lower <= R z <= upper

Each iterate is the minimum on the active rows, with multipliers of the right sign; a violated row becomes active, and
one whose multiplier would change its sign leaves (D. Goldfarb, A. Idnani, "A numerically stable dual method for solving
strictly convex quadratic programs", Mathematical Programming 27, 1983). R has far more rows than unknowns and few of
them are active, so the factor of the active rows' Gram matrix is computed anew where rows leave, and grows where they
enter. For Python there is daqp, which is the same in exact arithmetic.
"""

from __future__ import annotations

from math import isfinite, sqrt

import numpy as np

#: Violation up to which a bound counts as kept, in the unit of its row, and share of a row's squared length that must
#: be perpendicular to the active rows, or else it counts as dependent on them: for doubles, and for floats. DAQP's
#: tolerance of bounds is 1e-6.
TOLERANCES = (1e-9, 1e-10)
TOLERANCES_FLOAT = (3e-5, 1e-5)
#: Vectors of length n (the unknowns) in the work space, before the factor: places of the active rows, their sides,
#: multipliers, the next multipliers, and a scratch vector.
VECTORS = 5


def work_size(unknowns: int) -> int:
    """Length of the work space."""
    return 1 + VECTORS * unknowns + unknowns * unknowns


def dot(a: np.ndarray, b: np.ndarray, n: int) -> float:
    """a' b of vectors of length n."""
    total = 0.0
    for i in range(n):
        total += a[i] * b[i]
    return total


def project(rows: np.ndarray, row: int, work: np.ndarray, n: int, active: int) -> float:
    """Row of the factor for a further row of R, written to the scratch vector; returns the square of its last entry."""
    scratch = work[1 + 4 * n :]
    factor = work[1 + 5 * n :]
    left = dot(rows[row * n :], rows[row * n :], n)
    for k in range(active):
        total = dot(rows[row * n :], rows[int(work[1 + k]) * n :], n) - dot(factor[k * n :], scratch, k)
        scratch[k] = total / factor[k * n + k]
        left -= scratch[k] * scratch[k]
    return left


def enter(row: int, side: float, multiplier: float, left: float, work: np.ndarray, n: int, active: int) -> None:
    """Make a row active, whose row of the factor `project` has computed."""
    factor = work[1 + 5 * n :]
    scratch = work[1 + 4 * n :]
    work[1 + active] = float(row)
    work[1 + n + active] = side
    work[1 + 2 * n + active] = multiplier
    for k in range(active):
        factor[active * n + k] = scratch[k]
    factor[active * n + active] = sqrt(left)


def leave(rows: np.ndarray, place: int, work: np.ndarray, n: int, active: int) -> None:
    """Remove an active row, given by its place, and factorise the rows after it anew."""
    for k in range(place, active - 1):
        row = int(work[2 + k])
        side = work[2 + n + k]
        multiplier = work[2 + 2 * n + k]
        left = project(rows, row, work, n, k)
        enter(row, side, multiplier, left, work, n, k)


def least_on_active(
    rows: np.ndarray, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, work: np.ndarray, n: int, active: int
) -> None:
    """Next multipliers: those of the minimum with the active rows at their bounds."""
    following = work[1 + 3 * n :]
    factor = work[1 + 5 * n :]
    for k in range(active):
        row = int(work[1 + k])
        bound = upper[row] if work[1 + n + k] > 0.0 else lower[row]
        total = -bound - dot(rows[row * n :], f, n) - dot(factor[k * n :], following, k)
        following[k] = total / factor[k * n + k]
    backward(following, work, n, active)


def backward(vector: np.ndarray, work: np.ndarray, n: int, active: int) -> None:
    """Solve factor' x = vector in place."""
    factor = work[1 + 5 * n :]
    for back in range(active):
        k = active - 1 - back
        total = vector[k]
        for i in range(k + 1, active):
            total -= factor[i * n + k] * vector[i]
        vector[k] = total / factor[k * n + k]


def blocking_step(work: np.ndarray, n: int, active: int) -> int:
    """Move the multipliers towards the next ones as far as their signs allow; the place of the row that blocks, or
    `active` if none does."""
    share, block = 1.0, active
    for k in range(active):
        side, now, following = work[1 + n + k], work[1 + 2 * n + k], work[1 + 3 * n + k]
        if side * following < 0.0:
            ratio = now / (now - following) if side * now > 0.0 else 0.0
            if ratio < share or block == active:
                share, block = ratio, k
    for k in range(active):
        work[1 + 2 * n + k] += share * (work[1 + 3 * n + k] - work[1 + 2 * n + k])
    return block


def dependent_step(side: float, work: np.ndarray, n: int, active: int) -> int:
    """For a violated row that depends on the active ones (its projection is in the scratch vector): increase its
    multiplier until one of theirs is zero. The place of that row, or `active` where there is none: infeasible. The
    multiplier that the violated row has then is left in work[0]."""
    scratch = work[1 + 4 * n :]
    backward(scratch, work, n, active)
    step, block = 0.0, active
    for k in range(active):
        fall = work[1 + n + k] * side * scratch[k]
        if fall > 0.0:
            ratio = work[1 + n + k] * work[1 + 2 * n + k] / fall
            if block == active or ratio < step:
                step, block = max(ratio, 0.0), k
    if block < active:
        for k in range(active):
            work[1 + 2 * n + k] -= step * side * scratch[k]
    work[0] = step * side
    return block


def solve_qp(
    rows: np.ndarray,
    f: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    z: np.ndarray,
    y: np.ndarray,
    work: np.ndarray,
    n: int,
    bounds: int,
    limit: int,
    kept: float,
    dependent: float,
) -> float:
    """Solve the problem above; returns 0 if solved, 1 infeasible, 2 out of iterations, 3 not a number.

    rows: R (bounds, n), row by row. f (n,), lower and upper (bounds,). z (n,): gets the solution. y (bounds,):
    multipliers, positive at an upper bound, as warm start and result. work (work_size(n),): work[0] becomes the number
    of iterations. limit: of iterations. kept, dependent: see TOLERANCES. z and y are valid only if it returns 0.
    """
    work[0] = 0.0
    for i in range(n):
        if not isfinite(f[i]):
            return 3.0
    for i in range(bounds):
        if not lower[i] <= upper[i]:
            return 1.0
    active = 0
    for i in range(bounds):
        if y[i] != 0.0 and active < n:
            left = project(rows, i, work, n, active)
            if left > dependent * dot(rows[i * n :], rows[i * n :], n):
                enter(i, 1.0 if y[i] > 0.0 else -1.0, y[i], left, work, n, active)
                active += 1
                continue
        y[i] = 0.0
    iterations = 0
    while iterations < limit:
        iterations += 1
        least_on_active(rows, f, lower, upper, work, n, active)
        block = blocking_step(work, n, active)
        if block < active:
            y[int(work[1 + block])] = 0.0
            leave(rows, block, work, n, active)
            active -= 1
            continue
        for i in range(n):
            z[i] = -f[i]
        for k in range(active):
            row = int(work[1 + k]) * n
            multiplier = work[1 + 2 * n + k]
            for i in range(n):
                z[i] -= rows[row + i] * multiplier
        worst, violated, side = kept, bounds, 1.0
        for i in range(bounds):
            if y[i] != 0.0:
                continue  # active: at its bound but for rounding
            value = dot(rows[i * n :], z, n)
            if value - upper[i] > worst:
                worst, violated, side = value - upper[i], i, 1.0
            if lower[i] - value > worst:
                worst, violated, side = lower[i] - value, i, -1.0
        if violated == bounds:
            for k in range(active):
                y[int(work[1 + k])] = work[1 + 2 * n + k]
            work[0] = float(iterations)
            return 0.0
        multiplier = 0.0
        left = project(rows, violated, work, n, active)
        while active == n or left <= dependent * dot(rows[violated * n :], rows[violated * n :], n):
            block = dependent_step(side, work, n, active)
            if block == active:
                work[0] = float(iterations)
                return 1.0
            multiplier += work[0]
            y[int(work[1 + block])] = 0.0
            leave(rows, block, work, n, active)
            active -= 1
            left = project(rows, violated, work, n, active)
        enter(violated, side, multiplier, left, work, n, active)
        y[violated] = side
        active += 1
    work[0] = float(iterations)
    return 2.0


#: The functions of the solver, each after those that it calls.
SOLVER_FUNCTIONS = (
    dot, project, enter, leave, least_on_active, backward, blocking_step, dependent_step, solve_qp
)  # fmt: skip
