"""What an MPC's cost and constraints are stated with in cvxpy: predicted signals and the reference, in SI units.

Every term is affine in the unknown currents and in one parameter, so that the problem is canonicalised once and only
its vectors change from sample to sample (A. Agrawal, R. Verschueren, S. Diamond, S. Boyd, "A rewriting system for
convex optimization problems", J. Control and Decision 5(1), 2018; disciplined parametrised programming).
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .mpc_problem import MpcProblem, predict_states
from .regulator import positive_root

if TYPE_CHECKING:
    import cvxpy


class MpcTerms:
    """Terms of an MPC's problem over the horizon of N samples, as expressions of cvxpy.

    Attributes
    ----------
    horizon: N. sample_time: s. current_limit: A.
    effort: (N,) current beyond what the planned motion needs [A], the unknowns of the problem.
    """

    def __init__(self, problem: MpcProblem) -> None:
        import cvxpy

        self._cp: Any = cvxpy
        self._problem, self._ahead = problem, predict_states(problem)
        self.horizon, self.sample_time = problem.horizon, problem.model.sample_time
        self.current_limit = problem.current_limit
        self.effort: cvxpy.Variable = self._cp.Variable(self.horizon, name="effort")
        self.parameter: cvxpy.Parameter = self._cp.Parameter(problem.parameters, name="sample")

    def _signal(self, name: str) -> Any:
        """(N,) a signal of the design model at the samples 1 to N."""
        row = self._problem.model.row(name)
        ahead, target = self._ahead, self._problem.target
        seen, steps = np.r_[row, 0.0], range(1, self.horizon + 1)
        forced = np.array([seen @ ahead.forced[i] for i in steps])
        free = np.array([seen @ ahead.free[i] + row @ target.Pi @ ahead.w[i] for i in steps])
        return forced @ self.effort + free @ self.parameter

    def _reference(self, column: int) -> Any:
        rows = np.array([self._ahead.w[i][column] for i in range(1, self.horizon + 1)])
        return rows @ self.parameter

    @cached_property
    def position(self) -> Any:
        """(N,) rod position at the samples 1 to N [m]."""
        return self._signal("position")

    @cached_property
    def speed(self) -> Any:
        """(N,) shaft speed at the samples 1 to N [rad/s]."""
        return self._signal("speed")

    @cached_property
    def pressure(self) -> Any:
        """(N,) pressure difference p1 - p2 at the samples 1 to N [Pa]."""
        return self._signal("pressure")

    @cached_property
    def reference(self) -> Any:
        """(N,) planned position at the samples 1 to N [m]."""
        return self._reference(0)

    @cached_property
    def reference_velocity(self) -> Any:
        """(N,) planned velocity at the samples 1 to N [m/s]."""
        return self._reference(1)

    @cached_property
    def current(self) -> Any:
        """(N,) current of the drive from each sample 0 to N - 1 on [A], friction compensation included."""
        return self.effort + self._ahead.currents @ self.parameter

    @cached_property
    def current_change(self) -> Any:
        """(N,) change of the current from sample to sample [A]; the first from the last current that acted."""
        earlier = np.eye(self.horizon, k=-1)
        first = np.zeros((self.horizon, self._problem.parameters))
        first[0, -1] = 1.0
        return self.current - earlier @ self.current - first @ self.parameter

    @cached_property
    def cost_to_come(self) -> Any:
        """The regulator's cost from the last sample on, a terminal cost."""
        n = self._problem.model.A.shape[0]
        root = positive_root(self._problem.regulator.P[: n + 1, : n + 1])
        ahead = self._ahead
        last = ahead.forced[self.horizon] @ self.effort + ahead.free[self.horizon] @ self.parameter
        return self._cp.sum_squares(root.T @ last)

    @cached_property
    def cost(self) -> Any:
        """The whole cost of [weights]: each stage and the cost to come. Without limits its optimum is the LQR."""
        cost, ahead, n = self._problem.cost, self._ahead, self._problem.model.A.shape[0]
        root = positive_root(cost.Q)
        stages = np.vstack([root.T @ ahead.forced[i][:n] for i in range(self.horizon)])
        free = np.vstack([root.T @ ahead.free[i][:n] for i in range(self.horizon)])
        earlier, first = np.eye(self.horizon, k=-1), np.zeros((self.horizon, self._problem.parameters))
        first[0] = ahead.free[0][n]
        step = self.effort - earlier @ self.effort - first @ self.parameter
        total = self._cp.sum_squares(stages @ self.effort + free @ self.parameter) + self.cost_to_come
        return total + cost.R * self._cp.sum_squares(self.effort) + cost.R_rate * self._cp.sum_squares(step)
