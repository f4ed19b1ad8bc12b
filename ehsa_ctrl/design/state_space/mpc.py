"""The feedback law of an MPC: the quadratic programme of each sample, and a current for samples without a solution.

Estimate and target are those of the state feedback. Without an active limit the current is the LQR's. A sample without
a
solution in time is bridged: the first one by the next current of the last plan, further ones by the LQR's current, both
within the limits of current and rate.

`Mpc` runs in Python around a solver; `mpc_law` is the same sample as text for the export to C.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from math import isfinite
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..qp import QP_SOLVERS, SOLVED, QpSolver
from .mpc_problem import Condensed, MpcProblem, condense, motion_ahead
from .state_feedback import StateFeedback, estimate, predict, regulator_current, target_current

if TYPE_CHECKING:
    import control

#: Trace `solver_status`: origin of the current.
STATUS = {
    0.0: "solved",
    1.0: "solved; a soft limit is passed",
    2.0: "no solution: the next current of the plan before",
    3.0: "no solution: the regulator's current within the limits",
}
#: Trace `solver_reason`: how the solver ended.
REASON = {
    0.0: "solved",
    1.0: "infeasible",
    2.0: "the limit of iterations or time is reached",
    3.0: "the solver failed",
    4.0: "solved too late",
}
#: Relative violation from which a soft limit counts as exceeded; the exact solver leaves 1e-9.
PASSED = 1e-6
#: Places in the MPC's own memory: traces, then the last current and the age of the plan, then the plan.
_STATUS, _REASON, _ITERATIONS, _TIME, _SHARE, _GIVEN, _AGE, _PLAN = range(8)
#: Numbers before the feedback's settings in those of `mpc_law`.
EMBEDDED_HEAD = 15


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
    """Estimate; return Gamma w [A], f (v,) and both bounds (v + g,) of this sample's problem (see Condensed).

    changing: extra and the last current [A], and hold. shrink: (n,) 1 / SI value of a z of 1.
    """
    estimate(measured, memory, settings, changing[2])
    known = target_current(reference[0], reference[1], reference[2], memory, settings)
    n = shrink.size
    p = np.empty(F.shape[1])
    for i in range(n):
        p[i] = memory[4 + n + i] * shrink[i]
    motion_ahead(reference, settings[4], (p.size - n - 4) // 3 - 1, p[n:])
    p[-4], p[-3], p[-2], p[-1] = memory[2], changing[0], changing[1], 1.0
    shift = T @ p
    return known, F @ p, lower + shift, upper + shift


def apply_plan(
    reference: np.ndarray, memory: np.ndarray, feedback: np.ndarray, own: np.ndarray,
    extra: float, known: float, limit: float, change: float, horizon: int, unknowns: int, bounds: int,
) -> float:  # fmt: skip
    """Current of a sample after the solver: of the new plan, else bridged within the limits of current and rate.

    own: the MPC's memory from its traces on; own[_REASON] is 0 for a new plan. change: largest change of the current
    per sample (0: any).
    """
    if own[_REASON] == 0.0:
        share = 0.0
        for i in range(horizon, unknowns):
            share = max(share, own[_PLAN + i])
        own[_SHARE], own[_STATUS], own[_AGE] = share, 1.0 if share > PASSED else 0.0, 0.0
        wanted = own[_PLAN] + known
    else:
        # No warm start from an iterate that is no solution.
        for i in range(bounds):
            own[_PLAN + unknowns + i] = 0.0
        own[_SHARE] = 0.0
        own[_AGE] += 1.0
        if own[_AGE] == 1.0:
            own[_STATUS] = 2.0
            wanted = own[_PLAN + 1] + known
        else:
            own[_STATUS] = 3.0
            wanted = regulator_current(reference[0], reference[1], reference[2], memory, feedback)
        if not isfinite(wanted):
            wanted = -extra
        bridged = min(max(wanted + extra, -limit), limit)
        if change > 0.0:
            bridged = min(max(bridged, own[_GIVEN] - change), own[_GIVEN] + change)
        wanted = bridged - extra
    given = min(max(wanted + extra, -limit), limit)
    own[_GIVEN] = given
    predict(given - extra, known, memory, feedback)
    return given


@cache
def _compiled() -> Any:
    """Functions that run each sample beside the solver, compiled; the first compilation takes some 10 s."""
    from ...core.compiled import load_compiled
    from ..stages.pipeline import HEAD, source_text

    names = ("PASSED", "_STATUS", "_REASON", "_SHARE", "_GIVEN", "_AGE", "_PLAN")
    constants = "\n".join(f"{name} = {globals()[name]!r}" for name in names)
    functions = (target_current, regulator_current, estimate, predict, motion_ahead, prepare, apply_plan)
    text = [HEAD, constants, *(f'@cached_njit(error_model="numpy")\n{source_text(each)}' for each in functions)]
    return load_compiled("\n\n\n".join(text), "the estimate of an MPC")


@dataclass(frozen=True)
class Mpc:
    """Feedback law of an MPC, a design.controller.Law that runs as plain Python around a solver.

    Attributes
    ----------
    feedback: the law without limits: model, target, observer and regulator.
    problem: the quadratic programme. solver: a key of QP_SOLVERS.
    iteration_limit: of the solver, per sample.
    deadline: s, after which a solution is too late; None waits for it. With one, a run depends on the machine.
    external: a solver of this problem in place of the named one.
    """

    feedback: StateFeedback
    problem: MpcProblem
    solver: str = "daqp"
    iteration_limit: int = 200
    deadline: float | None = None
    external: QpSolver | None = field(default=None, repr=False)
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
        """Length of the feedback's memory, with which an MPC's begins."""
        return int(self.feedback.initial_memory().size)

    @property
    def largest_change(self) -> float:
        """Largest change of the current per sample [A]; 0 for any."""
        return (self.problem.limits.current_rate or 0.0) * self.feedback.model.sample_time

    @property
    def multipliers(self) -> slice:
        """Places of the multipliers in memory."""
        start = self._behind + _PLAN + len(self.condensed.F)
        return slice(start, start + self.condensed.lower.size)

    @cached_property
    def condensed(self) -> Condensed:
        return condense(self.problem)

    @cached_property
    def qp(self) -> QpSolver:
        if self.external is not None:
            return self.external
        return QP_SOLVERS[self.solver].make(self.condensed.H, self.condensed.G, self.iteration_limit, self.deadline)

    @cached_property
    def _fixed(self) -> tuple[np.ndarray, ...]:
        """Constant arguments of `prepare`."""
        c = self.condensed
        scale = np.r_[self.feedback.model.scale, self.feedback.model.disturbance_scale]
        return 1.0 / scale, np.ascontiguousarray(c.F), np.ascontiguousarray(c.T), c.lower, c.upper

    def __getstate__(self) -> dict[str, Any]:
        """Without the solver's workspace, which can't be pickled; another process makes its own."""
        return {name: value for name, value in self.__dict__.items() if name != "qp"}

    def settings(self) -> np.ndarray:
        return self.feedback.settings()

    def initial_memory(self) -> np.ndarray:
        own = np.zeros(_PLAN + len(self.condensed.F) + self.condensed.lower.size)
        own[_AGE] = 2.0  # no plan yet
        return np.concatenate([self.feedback.initial_memory(), own])

    def linear(self) -> control.StateSpace:
        """The law without active limits: the regulator's."""
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
        """One sample, as `state_feedback`. memory: the feedback's, then _STATUS to _AGE, plan and multipliers."""
        parts, own, v = _compiled(), memory[self._behind :], len(self.condensed.F)
        begin = perf_counter()
        changing = float(extra), float(own[_GIVEN]), float(hold)
        known, f, lower, upper = parts.prepare(reference, measured, memory, settings, changing, *self._fixed)
        plan, multipliers = own[_PLAN : _PLAN + v], own[_PLAN + v :]
        solution = self.qp.solve(f, lower, upper, plan, multipliers)
        seconds = perf_counter() - begin
        reason = float(solution.status)
        if reason == SOLVED and not isfinite(solution.x[0]):
            reason = 3.0
        if reason == SOLVED and self.deadline is not None and seconds > self.deadline:
            reason = 4.0
        own[_REASON], own[_ITERATIONS], own[_TIME] = reason, solution.iterations, seconds
        if reason == SOLVED:
            plan[:], multipliers[:] = solution.x, solution.y
        limits = self.problem.current_limit, self.largest_change
        sizes = self.horizon, v, multipliers.size
        return float(
            parts.apply_plan(reference, memory, settings, own, changing[0], known, *map(float, limits), *sizes)
        )

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


def solve_qp(
    f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray, iterations: np.ndarray
) -> float:
    """Placeholder of the generated solver: x and y are the start and, if it returns 0, the solution; otherwise it
    returns a key of REASON. iterations[0]: their number.
    """
    raise NotImplementedError("the solver is written in C")


def mpc_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of an MPC.

    settings: first index of the feedback's settings; length of its memory; current limit; largest change of the current
    per sample (0: any); samples of the horizon; numbers of unknowns, of bounds, of states and disturbances, and of
    parameters; first indices of shrink, F, T, lower, upper and root; then the feedback's settings, then these. They are
    those of `prepare`, but the solver's unknowns are z with theta = root z, and root' F replaces F.
    memory: the feedback's, then as in Mpc, then z and room for a sample's parameters, f and both bounds.
    """
    begin, behind, limit, change = int(settings[0]), int(settings[1]), settings[2], settings[3]
    horizon, unknowns, bounds, n, size = (
        int(settings[4]), int(settings[5]), int(settings[6]), int(settings[7]), int(settings[8])
    )  # fmt: skip
    shrink, F, T = int(settings[9]), int(settings[10]), int(settings[11])
    below, above, root = int(settings[12]), int(settings[13]), int(settings[14])
    feedback = settings[begin:]
    own = memory[behind:]
    solution = own[_PLAN:]
    multipliers = solution[unknowns:]
    z = multipliers[bounds:]
    p = z[unknowns:]
    f = p[size:]
    lower = f[unknowns:]
    upper = lower[bounds:]
    estimate(measured, memory, feedback, hold)
    known = target_current(reference[0], reference[1], reference[2], memory, feedback)
    for i in range(n):
        p[i] = memory[4 + n + i] * settings[shrink + i]
    motion_ahead(reference, feedback[4], horizon, p[n:])
    p[size - 4], p[size - 3], p[size - 2], p[size - 1] = memory[2], extra, own[_GIVEN], 1.0
    for i in range(unknowns):
        total = 0.0
        for k in range(size):
            total += settings[F + i * size + k] * p[k]
        f[i] = total
    for i in range(bounds):
        shift = 0.0
        for k in range(size):
            shift += settings[T + i * size + k] * p[k]
        lower[i] = settings[below + i] + shift
        upper[i] = settings[above + i] + shift
    own[_REASON] = solve_qp(f, lower, upper, z, multipliers, own[_ITERATIONS:])
    if own[_REASON] == 0.0:
        for i in range(unknowns):
            entry = 0.0
            for k in range(unknowns):
                entry += settings[root + i * unknowns + k] * z[k]
            solution[i] = entry
    return apply_plan(reference, memory, feedback, own, extra, known, limit, change, horizon, unknowns, bounds)


#: Functions that `mpc_law` calls.
EMBEDDED_USES = (target_current, regulator_current, estimate, predict, motion_ahead, apply_plan)
