"""Solvers of quadratic programmes, one per file. A new file adds its solver to every MPC."""

import sys

from ...core.registry import members
from ._solver import FAILED, INFEASIBLE, LIMIT, NO_BOUND, SOLVED, QpKind, QpSolution, QpSolver, is_strictly_convex

QP_SOLVERS: dict[str, QpKind] = members(sys.modules[__name__], "solver")

__all__ = [
    "FAILED",
    "INFEASIBLE",
    "LIMIT",
    "NO_BOUND",
    "QP_SOLVERS",
    "SOLVED",
    "QpKind",
    "QpSolution",
    "QpSolver",
    "is_strictly_convex",
]
