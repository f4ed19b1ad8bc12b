"""An MPC with a solver that can be generated as C: OSQP with a fixed step size and without polishing.

Generated code has neither step size adaptation nor polishing, which need new factorisations. A solution depends on its
warm start and on nothing else of the past. The unknowns are z with theta = root z and the cost z' z / 2, because the
eigenvalues of an MPC's own H differ by a factor of a million and OSQP's residuals would say little about the current.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import InputError
from ..controller import SampledController
from ..qp import QP_SOLVERS, SOLVED, QpSolution, QpSolver
from ..qp.osqp import ITERATIONS, Osqp, osqp_workspace
from ..stages.pipeline import M_LAW
from ..state_space.mpc import SAMPLE_FUNCTIONS, Mpc, mpc_law

#: Step sizes to try on the problems of a run, around OSQP's default of 0.1.
STEP_SIZES = (0.01, 0.03, 0.1, 0.3)
#: Iterations of the exact solver, enough for it never to stop early.
EXACT_ITERATIONS = 10_000


class EmbeddedOsqp(Osqp):
    """OSQP with the features of its generated code. rho: step size."""

    def __init__(self, H: np.ndarray, A: np.ndarray, iteration_limit: int, rho: float) -> None:
        self._inverse_root, self._root = np.linalg.cholesky(H).T, root_of(H)
        rows = np.vstack([self._root, A @ self._root])
        self._problem: Any = osqp_workspace(
            np.eye(len(H)), rows, iteration_limit, polishing=False, adaptive_rho=False, rho=rho
        )

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        inner = super().solve(self._root.T @ f, lower, upper, self._inverse_root @ x, y)
        if inner.status != SOLVED:
            return inner
        return QpSolution(inner.status, self._root @ inner.x, inner.y, inner.iterations)

    def generate(self, folder: Path) -> None:
        """Write the solver with this problem as C into a new folder: plain files, no build system."""
        self._problem.codegen(str(folder), prefix="ehsa_", extension_name=None)
        # OSQP's example and makefile; the export has a makefile of its own.
        for name in ("emosqp.c", "Makefile"):
            (folder / name).unlink(missing_ok=True)


def root_of(H: np.ndarray) -> np.ndarray:
    """The matrix (n, n) with theta' H theta = z' z for theta = root z."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(H)).T)


def exact_solver(law: Mpc) -> QpSolver:
    """DAQP for the problem of an MPC."""
    return QP_SOLVERS["daqp"].make(law.condensed.H, law.condensed.G, EXACT_ITERATIONS, None)


class ProblemRecorder:
    """A solver that records its problems."""

    def __init__(self, solver: QpSolver) -> None:
        self._solver = solver
        self.problems: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        self.problems.append((f.copy(), lower.copy(), upper.copy()))
        return self._solver.solve(f, lower, upper, x, y)


def tuned_solver(
    controller: SampledController, reference: np.ndarray, measured: np.ndarray
) -> tuple[EmbeddedOsqp, float]:
    """OSQP for a controller's MPC, and its step size: with the fewest unsolved problems of a run, then the fewest
    iterations.

    Raises InputError if every step size leaves more than one problem in ten unsolved.
    """
    law: Mpc = controller.law  # type: ignore[assignment]
    condensed, best = law.condensed, 0.0
    problems = _problems_of_run(controller, reference, measured)
    least = len(problems) // 10 + 1, 0
    for rho in STEP_SIZES:
        solver = EmbeddedOsqp(condensed.H, condensed.G, law.iteration_limit, rho)
        x, y, work = np.zeros(len(condensed.F)), np.zeros(condensed.lower.size), (0, 0)
        for f, lower, upper in problems:
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
            "iterations: raise [solver] iteration_limit, or choose weights of more similar size"
        )
    return EmbeddedOsqp(condensed.H, condensed.G, law.iteration_limit, best), best


def _problems_of_run(
    controller: SampledController, reference: np.ndarray, measured: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """f and both bounds of every sample of a run with this controller, whose law is an MPC."""
    recorder = ProblemRecorder(controller.law.qp)  # type: ignore[attr-defined]
    recorded = replace(controller, law=replace(controller.law, external=recorder))  # type: ignore[type-var]
    memory = recorded.initial_memory()
    for r, y in zip(reference, measured, strict=True):
        recorded.step(r, y, memory)
    return recorder.problems


def replay_with_exact(
    controller: SampledController, exact: SampledController, reference: np.ndarray, measured: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Currents (N,) of a controller with an MPC and of an exact one from the same memory, and unsolved samples (N,)."""
    law: Mpc = controller.law  # type: ignore[assignment]
    memory, multipliers = controller.initial_memory(), law.multipliers
    currents, unsolved = np.empty((2, len(reference))), np.zeros(len(reference), dtype=bool)
    reason = controller.traces["solver_reason"]
    for k, (r, y) in enumerate(zip(reference, measured, strict=True)):
        other = memory.copy()
        # DAQP would take OSQP's almost zero multipliers for active limits.
        other[M_LAW:][multipliers] = 0.0
        currents[:, k] = controller.step(r, y, memory), exact.step(r, y, other)
        unsolved[k] = memory[reason] != 0.0
    return currents[0], currents[1], unsolved


@dataclass(frozen=True)
class EmbeddedMpc:
    """An MPC for the export, a design.controller.Law whose `function` is translated to C."""

    mpc: Mpc
    function = staticmethod(mpc_law)
    uses: tuple[Callable[..., Any], ...] = SAMPLE_FUNCTIONS
    compiles = False

    @property
    def reads(self) -> tuple[str, ...]:
        return self.mpc.reads

    @property
    def traces(self) -> Mapping[str, int]:
        return {name: index for name, index in self.mpc.traces.items() if name != "solver_time"}

    @cached_property
    def _own_matrices(self) -> dict[str, np.ndarray]:
        root = root_of(self.mpc.condensed.H)
        return {**self.mpc.matrices, "F": root.T @ self.mpc.condensed.F, "root": root}

    @property
    def matrices(self) -> dict[str, np.ndarray]:
        """The matrices at the end of the settings."""
        return {**self.mpc.feedback.matrices, **self._own_matrices}

    def settings(self) -> np.ndarray:
        return self.mpc.settings_with(self._own_matrices)

    def initial_memory(self) -> np.ndarray:
        return self.mpc.initial_memory()

    def linear(self) -> Any:
        return self.mpc.linear()

    def __str__(self) -> str:
        return str(self.mpc)
