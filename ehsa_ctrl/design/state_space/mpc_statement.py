"""The quadratic programme of an MPC in cvxpy, with the states as unknowns: a reference for the condensed problem.

Far too slow for the loop; it verifies solutions with any solver of cvxpy.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from .mpc_problem import MpcProblem
from .regulator import MOTION, positive_root


class MpcStatement:
    """An MPC's problem in cvxpy, with parameters that change from sample to sample."""

    def __init__(self, problem: MpcProblem) -> None:
        self.problem = problem

    @cached_property
    def parts(self) -> tuple[Any, dict[str, Any], Any]:
        """The cvxpy problem, its parameters by name, and the currents u (N,)."""
        import cvxpy

        cp: Any = cvxpy
        model, target, cost = self.problem.model, self.problem.target, self.problem.cost
        limits, N = self.problem.limits, self.problem.horizon
        n, d = model.E.shape
        w = cp.Parameter((N + 1, MOTION + d), name="w")
        x_first, before = cp.Parameter(n, name="x"), cp.Parameter(name="before")
        extra, given = cp.Parameter(name="extra"), cp.Parameter(name="given")
        xi, mu, shares = cp.Variable((N + 1, n)), cp.Variable(N), cp.Variable(len(limits.soft), nonneg=True)
        u = [mu[i] + target.Gamma @ w[i] for i in range(N)]
        root, to_come = positive_root(cost.Q), positive_root(self.problem.regulator.P[: n + 1, : n + 1])
        total = cp.sum_squares(to_come.T @ cp.hstack([xi[N], mu[N - 1]]))
        rules = [xi[0] == x_first - target.Pi @ w[0]]
        for i in range(N):
            earlier = mu[i - 1] if i else before
            total += cp.sum_squares(root.T @ xi[i]) + cost.R * cp.square(mu[i])
            total += cost.R_rate * cp.square(mu[i] - earlier)
            rules += [xi[i + 1] == model.A @ xi[i] + model.B * mu[i]]
            rules += [cp.abs(u[i] + extra) <= self.problem.current_limit]
            if limits.current_rate is not None:
                change = u[i] - u[i - 1] if i else u[0] + extra - given
                rules += [cp.abs(change) <= limits.current_rate * model.sample_time]
        for k, (signal, limit) in enumerate(limits.soft.items()):
            row = model.row(signal) / limit
            total += self.problem.penalty * (shares[k] + 0.5 * cp.square(shares[k]))
            seen = cp.hstack([row @ (xi[i] + target.Pi @ w[i]) for i in range(1, N + 1)])
            rules += [cp.abs(seen) <= 1.0 + shares[k]]
        parameters = {"x": x_first, "w": w, "before": before, "extra": extra, "given": given}
        return cp.Problem(cp.Minimize(total), rules), parameters, cp.hstack(u)

    def solve(self, p: np.ndarray, solver: str = "CLARABEL", **options: Any) -> np.ndarray:
        """Currents u (N,) [A] for the parameters p (see `MpcProblem.parameters`). Raises cvxpy.SolverError."""
        problem, parameters, currents = self.parts
        n, d = self.problem.model.E.shape
        motion = p[n + d : -3].reshape(-1, MOTION)
        parameters["x"].value = p[:n]
        parameters["w"].value = np.hstack([motion, np.tile(p[n : n + d], (len(motion), 1))])
        for name, value in zip(("before", "extra", "given"), p[-3:], strict=True):
            parameters[name].value = value
        problem.solve(solver=solver, **options)
        return np.asarray(currents.value)
