"""DAQP: a dual active-set method, exact, warm-started from the active constraints of the last solution.

D. Arnstrom, A. Bemporad, D. Axehill, "A dual active-set solver for embedded quadratic programming using recursive LDL'
updates", IEEE Trans. Automatic Control 67(8), 2022.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from ._solver import FAILED, INFEASIBLE, LIMIT, SOLVED, QpKind, QpSolution

#: DAQP's flags of a constraint in the initial working set: active, at its lower bound.
ACTIVE, LOWER = 1, 2
#: DAQP's exit flags -> status; any other is a failure.
FLAGS = {1: SOLVED, -1: INFEASIBLE, -4: LIMIT, -7: LIMIT}


class Daqp:
    """A DAQP workspace."""

    def __init__(self, H: np.ndarray, A: np.ndarray, iteration_limit: int, time_limit: float | None) -> None:
        import daqp

        n = H.shape[0]
        self._data = np.ascontiguousarray(H), np.zeros(n), np.ascontiguousarray(A)
        bounds = np.ones(n + A.shape[0])
        self._model: Any = daqp.Model()
        self._model.setup(*self._data, bounds, -bounds, np.zeros(bounds.size, dtype=np.int32))
        # DAQP scales constraint rows to length 1; its default tolerance of 1e-6 would be visible in the currents.
        self._working = np.zeros(bounds.size, dtype=np.int32)
        self._model.settings = {"primal_tol": 1e-9, "iter_limit": iteration_limit, "time_limit": time_limit or 0.0}

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        if not isfinite(f.sum()):
            return QpSolution(FAILED, x, y, 0)
        # DAQP rejects an update with crossed bounds, and would then solve the last problem again.
        if not (lower <= upper).all():
            return QpSolution(INFEASIBLE, x, y, 0)
        self._working[:] = 0
        for i in y.nonzero()[0].tolist():
            self._working[i] = ACTIVE if y[i] > 0.0 else ACTIVE + LOWER
        if self._model.update(f=f, bupper=upper, blower=lower, sense=self._working) < 0:
            return QpSolution(FAILED, x, y, 0)
        solution, _, flag, info = self._model.solve()
        return QpSolution(FLAGS.get(int(flag), FAILED), solution, info["lam"], int(info["iterations"]))


solver = QpKind("daqp", "dual active-set method, exact, warm-started: the default", True, Daqp)
