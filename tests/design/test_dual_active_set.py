"""The QP solver of exported code against DAQP and against the conditions of optimality."""

import numpy as np
import pytest

from ehsa_ctrl.design.qp import QP_SOLVERS
from ehsa_ctrl.design.qp._dual_active_set import TOLERANCES, solve_qp, work_size


def problem(seed):
    """A random problem in z: rows of R, f and both bounds; some rows twice, some bounds that exclude each other."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 7)), int(rng.integers(1, 15))
    rows = rng.normal(size=(m, n))
    if seed % 3 == 0:
        rows = np.round(rows)
        rows = np.vstack([rows, rows[:2]])
        rows = rows[np.abs(rows).sum(axis=1) > 0.0]
    R = np.vstack([np.eye(n), rows])
    lower, upper = -rng.random(len(R)), rng.random(len(R))
    if seed % 5 == 0:
        lower += 0.3 * rng.normal(size=len(R))
        upper = np.maximum(lower, upper)
    return rng, R, 3.0 * rng.normal(size=n), lower, upper


def solve(R, f, lower, upper, y, limit=200):
    n, y = R.shape[1], y.copy()
    z, work = np.zeros(n), np.zeros(work_size(n))
    status = solve_qp(R.ravel(), f, lower, upper, z, y, work, n, len(R), limit, *TOLERANCES)
    return status, z, y, work[0]


@pytest.mark.parametrize("warm", [False, True])
def test_it_is_daqp(warm):
    """The same problems are feasible, and the solutions equal, from any warm start; the multipliers satisfy the
    conditions of Karush, Kuhn and Tucker."""
    feasible = 0
    for seed in range(80):
        rng, R, f, lower, upper = problem(seed)
        n = R.shape[1]
        start = rng.normal(size=len(R)) * (rng.random(len(R)) < 0.3) if warm else np.zeros(len(R))
        status, z, y, _ = solve(R, f, lower, upper, start)
        daqp = QP_SOLVERS["daqp"].make(np.eye(n), R[n:], 1000, None)
        other = daqp.solve(f, lower, upper, np.zeros(n), np.zeros(len(R)))

        assert status == other.status, seed
        if status == 0.0:
            feasible += 1
            np.testing.assert_allclose(z, other.x, atol=1e-9)
            np.testing.assert_allclose(z + f + R.T @ y, 0.0, atol=1e-9)
            assert np.all(R @ z <= upper + 2e-9) and np.all(R @ z >= lower - 2e-9)
            np.testing.assert_allclose(y[y > 0.0] * (R @ z - upper)[y > 0.0], 0.0, atol=1e-7)
            np.testing.assert_allclose(y[y < 0.0] * (R @ z - lower)[y < 0.0], 0.0, atol=1e-7)
    assert 50 < feasible < 80


def test_the_solution_is_its_own_warm_start():
    """One iteration confirms it."""
    _, R, f, lower, upper = problem(1)
    _, z, y, _ = solve(R, f, lower, upper, np.zeros(len(R)))
    status, again, _, iterations = solve(R, f, lower, upper, y)

    assert (status, iterations) == (0.0, 1.0)
    np.testing.assert_allclose(again, z, atol=1e-12)


def test_what_has_no_solution_has_a_status():
    """Crossed bounds, a cost that is not a number, too few iterations."""
    _, R, f, lower, upper = problem(1)
    zero = np.zeros(len(R))

    assert solve(R, f, upper + 1.0, upper, zero)[0] == 1.0
    assert solve(R, np.nan * f, lower, upper, zero)[0] == 3.0
    assert solve(R, 100.0 * f, lower, upper, zero, limit=1)[0] == 2.0
