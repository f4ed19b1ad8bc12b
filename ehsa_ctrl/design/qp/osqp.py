"""OSQP: an operator-splitting method, as exact as its tolerance, warm-started.

B. Stellato, G. Banjac, P. Goulart, A. Bemporad, S. Boyd, "OSQP: an operator splitting solver for quadratic programs",
Math. Programming Computation 12, 2020.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from ._solver import FAILED, INFEASIBLE, LIMIT, SOLVED, QpKind, QpSolution

#: Tolerance of its residuals. At its own 1e-3 single currents of an MPC are wrong by tenths of their limit.
TOLERANCE = 1e-6
#: One iteration is cheap: this many of them stand for one of an active-set method in a limit of iterations.
ITERATIONS = 50
#: Its own words for how a solve ended.
WORDS = {
    "solved": SOLVED,
    "primal infeasible": INFEASIBLE,
    "maximum iterations reached": LIMIT,
    "run time limit reached": LIMIT,
}


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
        import osqp
        from scipy import sparse

        n = H.shape[0]
        rows = sparse.csc_matrix(np.vstack([np.eye(n), A]))
        self._problem: Any = osqp.OSQP()
        limit = {} if time_limit is None else {"time_limit": time_limit}
        self._problem.setup(
            sparse.csc_matrix(np.triu(H)),
            np.zeros(n),
            rows,
            np.full(rows.shape[0], -1.0),
            np.full(rows.shape[0], 1.0),
            verbose=False,
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=ITERATIONS * iteration_limit,
            polishing=True,
            **limit,
        )

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        if not isfinite(f.sum()):
            return QpSolution(FAILED, x, y, 0)
        if not (lower <= upper).all():
            return QpSolution(INFEASIBLE, x, y, 0)
        self._problem.update(q=f, l=lower, u=upper)
        self._problem.warm_start(x=x, y=y)
        result = self._problem.solve(raise_error=False)
        return QpSolution(WORDS.get(str(result.info.status), FAILED), result.x, result.y, int(result.info.iter))


solver = QpKind("osqp", "operator splitting, as exact as its tolerance, warm-started", False, Osqp)
