"""An MPC's problem with cones, such as a norm in a constraint, solved in each sample by Clarabel.

    minimise 1/2 z' P z + q' z    subject to    b - A z in K

P, A and the cones K are constant, q and b affine in the sample's parameter, so that cvxpy is needed once.

P. J. Goulart, Y. Chen, "Clarabel: An interior-point solver for conic programs with quadratic objectives", 2024.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..qp import FAILED, INFEASIBLE, LIMIT, NO_BOUND, SOLVED, QpSolution
from .mpc_canonical import Data, affine_in_parameter, currents_first, symmetric
from .mpc_problem import Condensed
from .mpc_terms import MpcTerms

#: Clarabel's words for a status; any other is a failure.
STATUS_WORDS = {
    "Solved": SOLVED,
    "PrimalInfeasible": INFEASIBLE,
    "AlmostPrimalInfeasible": INFEASIBLE,
    "MaxIterations": LIMIT,
    "MaxTime": LIMIT,
}


@dataclass(frozen=True)
class ConeSolver:
    """A solver of the problem above, a design.qp.QpSolver: f is q, the upper bounds after those of z are b.

    Attributes
    ----------
    P (n, n), A (m, n). dims: cvxpy's sizes of the cones in the order of the rows of A.
    iteration_limit, time_limit: per sample, s; None for any time.
    """

    P: np.ndarray
    A: np.ndarray
    dims: Any
    iteration_limit: int
    time_limit: float | None

    @cached_property
    def _parts(self) -> tuple[Any, Any, Any, Any]:
        import clarabel
        from cvxpy.reductions.solvers.conic_solvers import clarabel_conif
        from scipy import sparse

        settings: Any = clarabel.DefaultSettings()
        settings.verbose, settings.max_iter = False, self.iteration_limit
        if self.time_limit is not None:
            settings.time_limit = self.time_limit
        P, A = sparse.csc_matrix(np.triu(self.P)), sparse.csc_matrix(self.A)
        cvxpy_cones: Any = clarabel_conif
        return P, A, cvxpy_cones.dims_to_solver_cones(self.dims), settings

    def __getstate__(self) -> dict[str, Any]:
        """Without Clarabel's objects, which can't be pickled."""
        return {name: value for name, value in self.__dict__.items() if name != "_parts"}

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        import clarabel

        if not np.isfinite(f).all():
            return QpSolution(FAILED, x, y, 0)
        P, A, cones, settings = self._parts
        found = clarabel.DefaultSolver(P, f, A, upper[len(f) :], cones, settings).solve()
        status = STATUS_WORDS.get(str(found.status), FAILED)
        return QpSolution(status, np.asarray(found.x), np.zeros(y.size), int(found.iterations))


def cone_programme(
    problem: Any, terms: MpcTerms, iteration_limit: int, time_limit: float | None
) -> tuple[Condensed, ConeSolver]:
    """The problem as vectors that are affine in the parameter, and its solver.

    Raises InputError if a matrix depends on the parameter.
    """
    import cvxpy

    cp: Any = cvxpy
    dims: list[Any] = []

    def at(p: np.ndarray) -> Data:
        terms.parameter.value = p
        data = problem.get_problem_data(cp.CLARABEL)[0]
        dims.append(data["dims"])
        n = data["c"].size
        P = data["P"].toarray() if "P" in data else np.zeros((n, n))
        return [P, data["A"].toarray()], [data["c"], data["b"]], data["param_prob"]

    (P, A), (q, b), program = affine_in_parameter(at, terms.parameter.size)
    order = currents_first(program, terms, len(q))
    P, A, q = symmetric(P)[np.ix_(order, order)], A[:, order], q[order]
    n, m = len(q), len(b)
    none = np.full(n, NO_BOUND)
    posed = Condensed(
        H=P,
        F=q,
        G=A,
        lower=np.concatenate([-none, np.full(m, -NO_BOUND)]),
        upper=np.concatenate([none, np.zeros(m)]),
        T=np.vstack([np.zeros((n, b.shape[1])), b]),
        currents=np.zeros(q.shape[1]),
    )
    return posed, ConeSolver(P, A, dims[0], iteration_limit, time_limit)
