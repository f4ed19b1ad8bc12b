"""The interface of a quadratic programme solver.

    minimise 1/2 x' H x + f' x    subject to    lower <= (x, A x) <= upper

H and A are constant; f and the bounds change from sample to sample. A solver stores no solution: the caller passes the
last one as warm start, so that a run does not depend on earlier runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

#: Status of a solution; LIMIT: out of iterations or time.
SOLVED, INFEASIBLE, LIMIT, FAILED = 0, 1, 2, 3
#: A bound of this magnitude means no bound.
NO_BOUND = 1e30


#: Relative size of the smallest eigenvalue of H from which it counts as positive definite.
CONVEX = 1e-10


def is_strictly_convex(H: np.ndarray) -> bool:
    """Whether every direction costs something, as an active-set method requires."""
    eigenvalues = np.linalg.eigvalsh(H)
    return bool(eigenvalues[0] > CONVEX * eigenvalues[-1])


@dataclass(frozen=True, slots=True)
class QpSolution:
    """Result of a solver.

    Attributes
    ----------
    status: SOLVED, INFEASIBLE, LIMIT or FAILED; x and y are valid only if SOLVED.
    x: (n,). y: (n + m,) multipliers, above 0 at an upper bound and below 0 at a lower one.
    iterations: as the solver counts them.
    """

    status: int
    x: np.ndarray
    y: np.ndarray
    iterations: int


class QpSolver(Protocol):
    """A solver for given H and A."""

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        """Solve for f (n,) and bounds (n + m,); warm start x (n,), y (n + m,) from a similar problem, or zeros."""
        ...


@dataclass(frozen=True)
class QpKind:
    """A kind of solver.

    Attributes
    ----------
    name: `[solver] name` in a controller's TOML.
    summary: one line.
    exact: whether its solution is exact up to rounding rather than up to a tolerance.
    make: (H (n, n), A (m, n), largest number of iterations, time limit [s] or None) -> a solver.
    """

    name: str
    summary: str
    exact: bool
    make: Callable[[np.ndarray, np.ndarray, int, float | None], QpSolver]
