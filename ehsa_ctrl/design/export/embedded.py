"""An MPC for the export: its sample with a dual active-set solver, all in the subset of Python that becomes C.

The solver's unknowns are z with theta = root z and the cost z' z / 2, because the eigenvalues of an MPC's own H differ
by a factor of a million.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.errors import InputError
from ..controller import SampledController
from ..kinds._scheduled_mpc_law import SCHEDULED_FUNCTIONS, ScheduledMpc, scheduled_mpc_law
from ..qp import QP_SOLVERS, is_strictly_convex
from ..qp._dual_active_set import SOLVER_FUNCTIONS, TOLERANCES, work_size
from ..state_space.mpc import SAMPLE_FUNCTIONS, Mpc, mpc_law, solve_embedded
from ..state_space.mpc_cones import ConeSolver

#: Iterations of the exact solver, enough for it never to stop early.
EXACT_ITERATIONS = 10_000


def root_of(H: np.ndarray) -> np.ndarray:
    """The matrix (n, n) with theta' H theta = z' z for theta = root z."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(H)).T)


def exact_law(law: Mpc | ScheduledMpc) -> Mpc | ScheduledMpc:
    """The law with DAQP and without a deadline, whose effect is not reproducible."""
    if isinstance(law, ScheduledMpc):
        return replace(law, laws=tuple(_exact_mpc(each) for each in law.laws))
    return _exact_mpc(law)


def _exact_mpc(law: Mpc) -> Mpc:
    solver = QP_SOLVERS["daqp"].make(law.condensed.H, law.condensed.G, EXACT_ITERATIONS, None)
    return replace(law, deadline=None, external=solver)


def embedded_law(law: Mpc | ScheduledMpc, tolerances: tuple[float, float]) -> EmbeddedMpc | EmbeddedScheduledMpc:
    """The law for the export.

    Raises InputError for unknowns that have no quadratic cost, and for cones.
    """
    points = law.laws if isinstance(law, ScheduledMpc) else (law,)
    if any(isinstance(each.external, ConeSolver) for each in points):
        raise InputError("has cones, for which there is no C solver; expected a quadratic cost and linear constraints")
    if not all(is_strictly_convex(each.condensed.H) for each in points):
        raise InputError(
            "has unknowns without a quadratic cost, for which there is no C solver; expected squares instead of "
            "absolute values in the cost"
        )
    if isinstance(law, ScheduledMpc):
        return EmbeddedScheduledMpc(law, tolerances)
    return EmbeddedMpc(law, tolerances)


def replay_with_exact(
    controller: SampledController, exact: SampledController, reference: np.ndarray, measured: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Currents (N,) of a controller with an embedded law and of an exact one from the same memory, unsolved samples
    (N,), and iterations (N,)."""
    memory = controller.initial_memory()
    currents, unsolved = np.empty((2, len(reference))), np.zeros(len(reference), dtype=bool)
    iterations = np.zeros(len(reference), dtype=int)
    reason, count = controller.traces["solver_reason"], controller.traces["solver_iterations"]
    for k, (r, y) in enumerate(zip(reference, measured, strict=True)):
        other = memory.copy()
        currents[:, k] = controller.step(r, y, memory), exact.step(r, y, other)
        unsolved[k], iterations[k] = memory[reason] != 0.0, int(memory[count])
    return currents[0], currents[1], unsolved, iterations


@dataclass(frozen=True)
class _EmbeddedLaw(ABC):
    """A law for the export, a design.controller.Law whose `function` is translated to C. tolerances: of `solve_qp`."""

    mpc: Mpc | ScheduledMpc
    tolerances: tuple[float, float] = TOLERANCES
    compiles = False

    @property
    @abstractmethod
    def _unknowns(self) -> int:
        """Number of unknowns of the quadratic program."""

    @property
    @abstractmethod
    def _settings(self) -> np.ndarray: ...

    @property
    def reads(self) -> tuple[str, ...]:
        return self.mpc.reads

    @property
    def traces(self) -> Mapping[str, int]:
        return {name: index for name, index in self.mpc.traces.items() if name != "solver_time"}

    def settings(self) -> np.ndarray:
        return self._settings

    def initial_memory(self) -> np.ndarray:
        return np.concatenate([self.mpc.initial_memory(), np.zeros(work_size(self._unknowns))])

    def linear(self) -> Any:
        return self.mpc.linear()

    def __str__(self) -> str:
        return str(self.mpc)


@dataclass(frozen=True)
class EmbeddedMpc(_EmbeddedLaw):
    """An MPC for the export."""

    mpc: Mpc
    function = staticmethod(mpc_law)
    uses: tuple[Callable[..., Any], ...] = (*SOLVER_FUNCTIONS, *SAMPLE_FUNCTIONS, solve_embedded)

    @property
    def _unknowns(self) -> int:
        return len(self.mpc.condensed.F)

    @cached_property
    def _own_matrices(self) -> dict[str, np.ndarray]:
        """The matrices of the settings; each is stored column by column."""
        root, G = root_of(self.mpc.condensed.H), self.mpc.condensed.G
        own = {
            "root": root,
            "rows": np.vstack([root, G @ root]).T,
            "solver": np.array([float(self.mpc.iteration_limit), *self.tolerances]),
        }
        return {**self.mpc.matrices, "F": root.T @ self.mpc.condensed.F, **own}

    @property
    def matrices(self) -> dict[str, np.ndarray]:
        """The matrices at the end of the settings."""
        return {**self.mpc.feedback.matrices, **self._own_matrices}

    @cached_property
    def _settings(self) -> np.ndarray:
        return self.mpc.settings_with(self._own_matrices)


@dataclass(frozen=True)
class EmbeddedScheduledMpc(_EmbeddedLaw):
    """A scheduled MPC for the export."""

    mpc: ScheduledMpc
    function = staticmethod(scheduled_mpc_law)
    uses: tuple[Callable[..., Any], ...] = (*SOLVER_FUNCTIONS, *SCHEDULED_FUNCTIONS, solve_embedded)

    @property
    def _unknowns(self) -> int:
        return len(self.mpc.laws[0].condensed.F)

    @cached_property
    def _settings(self) -> np.ndarray:
        return self.mpc.settings_with([EmbeddedMpc(law, self.tolerances).settings() for law in self.mpc.laws])
