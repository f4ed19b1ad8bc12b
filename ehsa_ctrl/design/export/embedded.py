"""An MPC with the solver that can be written as C: OSQP with a fixed step size and without polishing.

Generated code has neither: a new step size would need a new factorisation, polishing another one. What is left depends
on the start that it is given and on nothing else of the past. It is given the problem in other unknowns z, theta =
root z, in which the cost is z' z / 2: an MPC's own H has eigenvalues a million apart, and the residuals that OSQP ends
with would say little of the current.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import InputError
from ..controller import SampledController
from ..mpc import EMBEDDED_HEAD, EMBEDDED_USES, Mpc, mpc_law
from ..qp import SOLVED, QpSolution, QpSolver
from ..qp.osqp import ITERATIONS, TOLERANCE, Osqp

#: Step sizes that are tried on the problems of a run.
STEP_SIZES = (0.01, 0.03, 0.1, 0.3)


class EmbeddedOsqp(Osqp):
    """OSQP with what generated code has. rho: its step size."""

    def __init__(self, H: np.ndarray, A: np.ndarray, iteration_limit: int, rho: float) -> None:
        import osqp
        from scipy import sparse

        self._into = np.linalg.cholesky(H).T
        self._root = root_of(H)
        rows = sparse.csc_matrix(np.vstack([self._root, A @ self._root]))
        self._problem: Any = osqp.OSQP()
        self._problem.setup(
            sparse.csc_matrix(np.eye(len(H))),
            np.zeros(len(H)),
            rows,
            np.full(rows.shape[0], -1.0),
            np.full(rows.shape[0], 1.0),
            verbose=False,
            eps_abs=TOLERANCE,
            eps_rel=TOLERANCE,
            max_iter=ITERATIONS * iteration_limit,
            polishing=False,
            adaptive_rho=False,
            rho=rho,
        )

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        inner = super().solve(self._root.T @ f, lower, upper, self._into @ x, y)
        if inner.status != SOLVED:
            return inner
        return QpSolution(inner.status, self._root @ inner.x, inner.y, inner.iterations)

    def generate(self, folder: Path) -> None:
        """Write the solver with this problem as C into a new folder: plain files, no build system."""
        self._problem.codegen(str(folder), prefix="ehsa_", extension_name=None)
        # Its example and its makefile, which ours replaces.
        for name in ("emosqp.c", "Makefile"):
            (folder / name).unlink(missing_ok=True)


def root_of(H: np.ndarray) -> np.ndarray:
    """The matrix (n, n) with which theta' H theta = z' z for theta = root z."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(H)).T)


class Recorder:
    """A solver that keeps what it was asked."""

    def __init__(self, solver: QpSolver) -> None:
        self._solver = solver
        self.asked: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        self.asked.append((f.copy(), lower.copy(), upper.copy()))
        return self._solver.solve(f, lower, upper, x, y)


@dataclass(frozen=True)
class MpcBy(Mpc):
    """An MPC with a solver that is handed in."""

    by: QpSolver | None = None

    @cached_property
    def qp(self) -> QpSolver:
        assert self.by is not None
        return self.by


def solved_by(law: Mpc, solver: QpSolver) -> MpcBy:
    """The same MPC with another solver; without a deadline, which no replay can repeat."""
    own = {field.name: getattr(law, field.name) for field in fields(Mpc)}
    return MpcBy(**{**own, "deadline": None}, by=solver)


def step_size(law: Mpc, asked: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    """The step size that leaves the fewest of a run's problems unsolved, and of these the one with the least work.

    Raises InputError if even that leaves more than one in ten.
    """
    condensed, best = law.condensed, 0.0
    least = len(asked) // 10 + 1, 0
    for rho in STEP_SIZES:
        solver = EmbeddedOsqp(condensed.H, condensed.G, law.iteration_limit, rho)
        x, y, work = np.zeros(len(condensed.F)), np.zeros(condensed.lower.size), (0, 0)
        for f, lower, upper in asked:
            solution = solver.solve(f, lower, upper, x, y)
            solved = solution.status == SOLVED
            x, y = (solution.x, solution.y) if solved else (x, np.zeros(y.size))
            work = work[0] + (not solved), work[1] + solution.iterations
            if work >= least:
                break
        else:
            best, least = rho, work
    if not best:
        raise InputError(
            f"OSQP solves less than nine in ten of this MPC's problems within {ITERATIONS * law.iteration_limit} "
            "iterations: raise [solver] iteration_limit, or take weights that are nearer to each other"
        )
    return best


@dataclass(frozen=True)
class EmbeddedMpc:
    """An MPC as the export writes it, a design.law.Law whose `function` is the text that becomes C."""

    mpc: Mpc
    function = staticmethod(mpc_law)
    uses: tuple[Callable[..., Any], ...] = EMBEDDED_USES
    compiles = False

    @property
    def reads(self) -> tuple[str, ...]:
        return self.mpc.reads

    @property
    def traces(self) -> Mapping[str, int]:
        return {name: index for name, index in self.mpc.traces.items() if name != "solver_time"}

    @property
    def matrices(self) -> dict[str, np.ndarray]:
        """What stands last in the settings."""
        condensed, model = self.mpc.condensed, self.mpc.feedback.model
        scale = np.r_[model.scale, model.disturbance_scale]
        root = root_of(condensed.H)
        cost = {"shrink": 1.0 / scale, "F": root.T @ condensed.F}
        bounds = {"T": condensed.T, "lower": condensed.lower, "upper": condensed.upper}
        return {**self.mpc.feedback.matrices, **cost, **bounds, "root": root}

    def settings(self) -> np.ndarray:
        law, model = self.mpc, self.mpc.feedback.model
        feedback = law.feedback.settings()
        matrices = self.matrices
        own = [matrices[name] for name in ("shrink", "F", "T", "lower", "upper", "root")]
        begins = EMBEDDED_HEAD + feedback.size + np.cumsum([0, *(part.size for part in own[:-1])])
        rate = law.problem.limits.current_rate
        change = 0.0 if rate is None else rate * model.sample_time
        behind = law.feedback.initial_memory().size
        condensed = law.condensed
        sizes = [law.horizon, *condensed.F.shape[:1], condensed.lower.size, own[0].size, condensed.F.shape[1]]
        head = [EMBEDDED_HEAD, behind, law.problem.current_limit, change, *sizes, *begins]
        return np.concatenate([np.array(head, dtype=float), feedback, *(part.ravel() for part in own)])

    def initial_memory(self) -> np.ndarray:
        condensed = self.mpc.condensed
        room = condensed.F.shape[1] + 2 * len(condensed.F) + 2 * condensed.lower.size
        return np.concatenate([self.mpc.initial_memory(), np.zeros(room)])

    def linear(self) -> Any:
        return self.mpc.linear()

    def __str__(self) -> str:
        return str(self.mpc)


def multipliers(controller: SampledController, behind: int) -> slice:
    """Where they stand in the memory of an MPC's controller; `behind`: where the law's own memory begins."""
    law = controller.law
    assert isinstance(law, Mpc)
    return slice(behind + law.multipliers.start, behind + law.multipliers.stop)


def with_law(controller: SampledController, law: Any) -> SampledController:
    """The same controller around another law."""
    return replace(controller, law=law)
