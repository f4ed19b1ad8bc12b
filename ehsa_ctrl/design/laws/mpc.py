"""Model predictive control: the regulator's problem with limits, solved each sample.

The estimate is that of state_feedback.py. Where no limit is active the current is the LQR's. A sample without a
solution in time is bridged: the first one by the next current of the plan before, further ones by the LQR's current,
both within the limits of current and rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from math import isfinite
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..qp import QP_SOLVERS, SOLVED, QpSolver
from .mpc_problem import Condensed, MpcProblem, ahead, condense
from .state_feedback import StateFeedback, estimate, predict, regulator_current, target_current

if TYPE_CHECKING:
    import control

#: What the trace `solver_status` says of a sample: what gave the current.
STATUS = {
    0.0: "solved",
    1.0: "solved; a soft limit is passed",
    2.0: "no solution: the next current of the plan before",
    3.0: "no solution: the regulator's current within the limits",
}
#: What the trace `solver_reason` says: how the solver ended.
REASON = {
    0.0: "solved",
    1.0: "infeasible",
    2.0: "the limit of iterations or time is reached",
    3.0: "the solver failed",
    4.0: "solved too late",
}
#: A share of a soft limit that counts as passing it.
PASSED = 1e-6
#: Places of the traces in memory behind the estimates', then the current given before and the age of the plan.
_STATUS, _REASON, _ITERATIONS, _TIME, _SHARE, _GIVEN, _AGE, _PLAN = range(8)


def prepare(
    reference: np.ndarray,
    measured: np.ndarray,
    memory: np.ndarray,
    settings: np.ndarray,
    changing: tuple[float, float, float],
    shrink: np.ndarray,
    F: np.ndarray,
    T: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Estimate, and give Gamma w [A], f (v,) and both bounds (v + g,) of this sample's problem (see Condensed).

    changing: extra and the current given before [A], and hold. shrink: (n,) 1 / SI value of a z of 1.
    """
    estimate(measured, memory, settings, changing[2])
    known = target_current(reference[0], reference[1], reference[2], memory, settings)
    n = shrink.size
    p = np.empty(F.shape[1])
    for i in range(n):
        p[i] = memory[4 + n + i] * shrink[i]
    ahead(reference[0], reference[1], reference[2], settings[4], p[n:-4].reshape(-1, 3))
    p[-4], p[-3], p[-2], p[-1] = memory[2], changing[0], changing[1], 1.0
    shift = T @ p
    return known, F @ p, lower + shift, upper + shift


@cache
def _compiled() -> Any:
    """`estimate`, `prepare` and the others that run each sample beside the solver, compiled once: some 10 s."""
    from ...core.compiled import load_compiled
    from ..stages.pipeline import HEAD, source_text

    functions = (target_current, regulator_current, estimate, predict, ahead, prepare)
    text = [HEAD, *(f'@cached_njit(error_model="numpy")\n{source_text(function)}' for function in functions)]
    return load_compiled("\n\n\n".join(text), "the estimate of an MPC")


@dataclass(frozen=True)
class Mpc:
    """An MPC, a design.law.Law that runs as plain Python around a solver.

    Attributes
    ----------
    feedback: the law without limits: model, target, observer and regulator.
    problem: what is solved. solver: name of one of QP_SOLVERS.
    iteration_limit: of the solver, each sample.
    deadline: s, after which a solution is too late; None waits for it. A run with one depends on the machine.
    """

    feedback: StateFeedback
    problem: MpcProblem
    solver: str = "daqp"
    iteration_limit: int = 200
    deadline: float | None = None
    uses = ()
    compiles = False

    @property
    def function(self) -> Any:
        return self.step

    @property
    def model(self) -> Any:
        return self.feedback.model

    @property
    def horizon(self) -> int:
        return self.problem.horizon

    @property
    def K(self) -> np.ndarray:
        """Gains (n,) per SI state where no limit is active."""
        return self.feedback.K

    @property
    def L(self) -> np.ndarray:
        """Gains (n + d, m) of the filter, SI."""
        return self.feedback.L

    @property
    def reads(self) -> tuple[str, ...]:
        return self.feedback.reads

    @property
    def traces(self) -> Mapping[str, int]:
        names = ("solver_status", "solver_reason", "solver_iterations", "solver_time", "limit_passed")
        return {**self.feedback.traces, **{name: self._behind + i for i, name in enumerate(names)}}

    @cached_property
    def _behind(self) -> int:
        """Length of the feedback's memory, with which that of an MPC begins."""
        return int(self.feedback.initial_memory().size)

    @cached_property
    def condensed(self) -> Condensed:
        return condense(self.problem)

    @cached_property
    def qp(self) -> QpSolver:
        kind = QP_SOLVERS[self.solver]
        return kind.make(self.condensed.H, self.condensed.G, self.iteration_limit, self.deadline)

    @cached_property
    def _fixed(self) -> tuple[np.ndarray, ...]:
        """What `prepare` gets that never changes."""
        c = self.condensed
        scale = np.r_[self.feedback.model.scale, self.feedback.model.disturbance_scale]
        return 1.0 / scale, np.ascontiguousarray(c.F), np.ascontiguousarray(c.T), c.lower, c.upper

    def __getstate__(self) -> dict[str, Any]:
        """Without the solver's workspace, which can't be sent to another process; it is made there again."""
        return {name: value for name, value in self.__dict__.items() if name != "qp"}

    def settings(self) -> np.ndarray:
        return self.feedback.settings()

    def initial_memory(self) -> np.ndarray:
        own = np.zeros(_PLAN + len(self.condensed.F) + self.condensed.lower.size)
        own[_AGE] = 2.0  # there is no plan before
        return np.concatenate([self.feedback.initial_memory(), own])

    def linear(self) -> control.StateSpace:
        """The law with no limit active: that of the regulator."""
        return self.feedback.linear()

    def step(
        self,
        reference: np.ndarray,
        measured: np.ndarray,
        memory: np.ndarray,
        settings: np.ndarray,
        extra: float,
        hold: float,
    ) -> float:
        """One sample, as `state_feedback`. memory: the feedback's, then see _STATUS ..., plan and multipliers."""
        parts = _compiled()
        own = memory[self._behind :]
        begin = perf_counter()
        changing = float(extra), float(own[_GIVEN]), float(hold)
        known, f, lower, upper = parts.prepare(reference, measured, memory, settings, changing, *self._fixed)
        wanted = self._solve((f, lower, upper), own, begin)
        if wanted is None:
            wanted = self._bridge(reference, memory, settings, own, extra)
        else:
            wanted += known
        limit = self.problem.current_limit
        given = min(max(wanted + extra, -limit), limit)
        own[_GIVEN] = given
        parts.predict(given - extra, known, memory, settings)
        return given

    def _solve(self, problem: tuple[np.ndarray, np.ndarray, np.ndarray], own: np.ndarray, begin: float) -> float | None:
        """mu of this sample from a new plan, or None; writes plan, multipliers and the traces."""
        N, v = self.horizon, len(self.condensed.F)
        plan, multipliers = own[_PLAN : _PLAN + v], own[_PLAN + v :]
        solution = self.qp.solve(*problem, plan, multipliers)
        seconds = perf_counter() - begin
        reason = float(solution.status)
        if reason == SOLVED and not isfinite(solution.x[0]):
            reason = 3.0
        if reason == SOLVED and self.deadline is not None and seconds > self.deadline:
            reason = 4.0
        own[_REASON], own[_ITERATIONS], own[_TIME] = reason, solution.iterations, seconds
        if reason != SOLVED:
            # A start from what did not end well would spoil the samples after it.
            multipliers[:] = 0.0
            own[_SHARE] = 0.0
            return None
        plan[:], multipliers[:] = solution.x, solution.y
        share = max(solution.x[N:].tolist(), default=0.0)
        own[_SHARE], own[_STATUS], own[_AGE] = share, 1.0 if share > PASSED else 0.0, 0.0
        return float(solution.x[0])

    def _bridge(
        self, reference: np.ndarray, memory: np.ndarray, settings: np.ndarray, own: np.ndarray, extra: float
    ) -> float:
        """A current for a sample without a solution, within the limits of current and rate."""
        parts, motion = _compiled(), (reference[0], reference[1], reference[2])
        own[_AGE] += 1.0
        if own[_AGE] == 1.0:
            own[_STATUS] = 2.0
            wanted = own[_PLAN + 1] + parts.target_current(*motion, memory, settings)
        else:
            own[_STATUS] = 3.0
            wanted = parts.regulator_current(*motion, memory, settings)
        if not isfinite(wanted):
            wanted = -extra
        limit, before = self.problem.current_limit, own[_GIVEN]
        given = min(max(wanted + extra, -limit), limit)
        if self.problem.limits.current_rate is not None:
            change = self.problem.limits.current_rate * self.feedback.model.sample_time
            given = min(max(given, before - change), before + change)
        return float(given - extra)

    def __str__(self) -> str:
        limits = [f"|current| <= {self.problem.current_limit:g} A"]
        if self.problem.limits.current_rate is not None:
            limits.append(f"|current rate| <= {self.problem.limits.current_rate:g} A/s")
        units = {"speed": "rad/s", "pressure": "Pa", "position": "m"}
        limits += [
            f"|{signal}| <= {limit:g} {units[signal]} (soft)" for signal, limit in self.problem.limits.soft.items()
        ]
        horizon = f"{self.horizon} samples ({self.horizon * self.feedback.model.sample_time:g} s)"
        return f"MPC over {horizon} by {self.solver}, {', '.join(limits)}; without them {self.feedback}"
