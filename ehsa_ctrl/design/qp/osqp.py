"""OSQP: an operator-splitting method, accurate to its tolerance, warm-started.

B. Stellato, G. Banjac, P. Goulart, A. Bemporad, S. Boyd, "OSQP: an operator splitting solver for quadratic programs",
Math. Programming Computation 12, 2020.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from ._solver import FAILED, INFEASIBLE, LIMIT, SOLVED, QpKind, QpSolution

#: Tolerance of the residuals. With OSQP's default of 1e-3, currents of an MPC were wrong by tenths of their limit.
TOLERANCE = 1e-6
#: OSQP's iterations are cheap: iteration_limit counts this many as one of an active-set method. Engineering judgement.
ITERATIONS = 50
#: OSQP's texts for a status.
STATUS_TEXTS = {
    "solved": SOLVED,
    "primal infeasible": INFEASIBLE,
    "maximum iterations reached": LIMIT,
    "run time limit reached": LIMIT,
}


def osqp_workspace(H: np.ndarray, rows: np.ndarray, iteration_limit: int, **options: Any) -> Any:
    """OSQP's solver for 1/2 x' H x + f' x with bounds on `rows` x. options: settings by OSQP's names."""
    import osqp
    from scipy import sparse

    problem: Any = osqp.OSQP()
    settings = {"verbose": False, "eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "max_iter": ITERATIONS * iteration_limit}
    bound = np.ones(rows.shape[0])
    problem.setup(
        sparse.csc_matrix(np.triu(H)), np.zeros(len(H)), sparse.csc_matrix(rows), -bound, bound, **settings | options
    )
    return problem


class Osqp:
    """An OSQP workspace."""

    def __init__(
        self,
        H: np.ndarray,
        A: np.ndarray,
        iteration_limit: int,
        time_limit: float | None,
        *,
        tolerance: float = TOLERANCE,
    ) -> None:
        options = {"polishing": True, "eps_abs": tolerance, "eps_rel": tolerance}
        if time_limit is not None:
            options["time_limit"] = time_limit
        self._problem: Any = osqp_workspace(H, np.vstack([np.eye(len(H)), A]), iteration_limit, **options)

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        if not isfinite(f.sum()):
            return QpSolution(FAILED, x, y, 0)
        if not (lower <= upper).all():
            return QpSolution(INFEASIBLE, x, y, 0)
        self._problem.update(q=f, l=lower, u=upper)
        self._problem.warm_start(x=x, y=y)
        result = self._problem.solve(raise_error=False)
        return QpSolution(STATUS_TEXTS.get(str(result.info.status), FAILED), result.x, result.y, int(result.info.iter))


solver = QpKind("osqp", "operator splitting, accurate to its tolerance, warm-started", False, Osqp)
