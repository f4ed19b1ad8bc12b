"""The feedback law of an MPC: the quadratic programme of each sample, and a fallback for samples without a solution.

Estimate and target are those of the state feedback. Without an active limit the current is the LQR's. The first sample
without a solution in time takes the next current of the last plan, further ones the LQR's current, both within the
limits of current and rate.

`Mpc` runs in Python around a solver; `mpc_law` is the same sample for the export to C.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from math import isfinite
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from ..qp import QP_SOLVERS, SOLVED, QpSolution, QpSolver
from ..qp._dual_active_set import solve_qp
from ..words import WordsByUnit, drive_limit
from .mpc_problem import Condensed, MpcProblem, condense, motion_ahead
from .state_feedback import StateFeedback, estimate, predict, regulator_current, target_current

if TYPE_CHECKING:
    import control

#: Trace `solver_status`: where the current comes from.
STATUS = {
    0.0: "solved",
    1.0: "solved; a soft limit is violated",
    2.0: "no solution: the next current of the last plan",
    3.0: "no solution: the regulator's current within the limits",
}
#: Trace `solver_reason`: how the solver ended.
REASON = {
    0.0: "solved",
    1.0: "infeasible",
    2.0: "the limit of iterations or time is reached",
    3.0: "the solver failed",
    4.0: "solved after the deadline",
}
#: Relative violation above which a soft limit counts as violated; the tolerance of the exact solver is 1e-9.
VIOLATED = 1e-6
#: Places in the MPC's part of the memory: traces, then the last current and the age of the plan, then the plan.
_STATUS, _REASON, _ITERATIONS, _TIME, _VIOLATION, _LAST, _AGE, _PLAN = range(8)
#: Numbers before the matrices in the MPC's part of the settings.
HEAD = 15


def multiply(matrix: np.ndarray, vector: np.ndarray, rows: int, columns: int, product: np.ndarray) -> None:
    """product (rows,) = matrix @ vector; the matrix is stored column by column, so that compilers vectorise this."""
    for i in range(rows):
        product[i] = 0.0
    for k in range(columns):
        factor = vector[k]
        for i in range(rows):
            product[i] += matrix[k * rows + i] * factor


def pose_problem(reference: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float) -> float:
    """Write parameters, f and both bounds of this sample's problem into memory; return Gamma w [A].

    settings: first index of the feedback's settings; length of its memory; current limit; largest change of the current
    per sample (0: any); samples of the horizon; numbers of unknowns, of bounds, of states and disturbances, and of
    parameters; first indices of shrink (1 / SI value of a state of 1), F, T, lower and upper (see Condensed); number of
    slacks among the unknowns, after the currents; then the feedback's settings, then these.
    memory: the feedback's; traces, last current and age of the plan; the plan and its multipliers; the solver's
    unknowns; parameters, f, lower and upper bounds.
    """
    begin, own_start, horizon = int(settings[0]), int(settings[1]), int(settings[4])
    unknowns, bounds, n, size = int(settings[5]), int(settings[6]), int(settings[7]), int(settings[8])
    shrink, F, T = int(settings[9]), int(settings[10]), int(settings[11])
    below, above = int(settings[12]), int(settings[13])
    feedback = settings[begin:]
    own = memory[own_start:]
    p = own[_PLAN + 2 * unknowns + bounds :]
    f = p[size:]
    lower = f[unknowns:]
    upper = lower[bounds:]
    for i in range(n):
        p[i] = memory[4 + n + i] * settings[shrink + i]
    motion_ahead(reference, feedback[4], horizon, p[n:])
    p[size - 4], p[size - 3], p[size - 2], p[size - 1] = memory[2], extra, own[_LAST], 1.0
    multiply(settings[F:], p, unknowns, size, f)
    multiply(settings[T:], p, bounds, size, lower)
    for i in range(bounds):
        shift = lower[i]
        lower[i] = settings[below + i] + shift
        upper[i] = settings[above + i] + shift
    return target_current(reference[0], reference[1], reference[2], memory, feedback)


def begin_sample(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """Estimate, then `pose_problem`."""
    estimate(measured, memory, settings[int(settings[0]) :], hold)
    return pose_problem(reference, memory, settings, extra)


def apply_plan(
    reference: np.ndarray, memory: np.ndarray, settings: np.ndarray, feedback: np.ndarray, extra: float, target: float
) -> float:
    """Current [A] of a sample after the solver: from the new plan, or the fallback within limits of current and rate.

    memory, settings: as in `pose_problem`; the trace of the reason is 0 for a new plan. feedback: settings of the
    regulator and its observer. target: Gamma w [A].
    """
    own_start, limit, change = int(settings[1]), settings[2], settings[3]
    horizon, unknowns, bounds = int(settings[4]), int(settings[5]), int(settings[6])
    own = memory[own_start:]
    if own[_REASON] == 0.0:
        violation = 0.0
        for i in range(horizon, horizon + int(settings[14])):
            violation = max(violation, own[_PLAN + i])
        own[_VIOLATION], own[_STATUS], own[_AGE] = violation, 1.0 if violation > VIOLATED else 0.0, 0.0
        wanted = own[_PLAN] + target
    else:
        # An unsolved iterate is no warm start.
        for i in range(bounds):
            own[_PLAN + unknowns + i] = 0.0
        own[_VIOLATION] = 0.0
        own[_AGE] += 1.0
        if own[_AGE] == 1.0:
            own[_STATUS] = 2.0
            wanted = own[_PLAN + 1] + target
        else:
            own[_STATUS] = 3.0
            wanted = regulator_current(reference[0], reference[1], reference[2], memory, feedback)
        if not isfinite(wanted):
            wanted = -extra
        fallback = min(max(wanted + extra, -limit), limit)
        if change > 0.0:
            fallback = min(max(fallback, own[_LAST] - change), own[_LAST] + change)
        wanted = fallback - extra
    current = min(max(wanted + extra, -limit), limit)
    own[_LAST] = current
    predict(current - extra, target, memory, feedback)
    return current


def end_sample(reference: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, target: float) -> float:
    """`apply_plan` with the feedback of the settings."""
    return apply_plan(reference, memory, settings, settings[int(settings[0]) :], extra, target)


#: The functions around the solver, each after those that it calls.
SAMPLE_FUNCTIONS = (
    target_current, regulator_current, estimate, predict, motion_ahead, multiply, pose_problem, begin_sample,
    apply_plan, end_sample,
)  # fmt: skip


def compile_around_solver(
    functions: Sequence[Callable[..., Any]], entries: Sequence[Callable[..., float]], constants: Mapping[str, int]
) -> Any:
    """A module with functions compiled, and ENTRY_of_arrays for each of `entries`; the first time takes about 3 s."""
    from ...core.compiled import load_compiled
    from ..stages.compiled import IMPORTS, entry_text, pointer_function

    names = ("VIOLATED", "_STATUS", "_REASON", "_VIOLATION", "_LAST", "_AGE", "_PLAN")
    numbers = {**{name: globals()[name] for name in names}, **constants}
    text = [IMPORTS, "\n".join(f"{name} = {value!r}" for name, value in numbers.items())]
    text += [pointer_function(function) for function in functions]
    text += [entry_text(function) for function in entries]
    return load_compiled("\n\n\n".join(text), "the estimate of an MPC")


@cache
def _compiled() -> Any:
    return compile_around_solver(SAMPLE_FUNCTIONS, (begin_sample, end_sample), {})


@dataclass(frozen=True)
class Mpc(WordsByUnit):
    """Feedback law of an MPC, a design.controller.Law that runs as plain Python around a solver.

    Attributes
    ----------
    feedback: the law without limits: model, target, observer and regulator.
    problem: the quadratic programme. solver: a key of QP_SOLVERS, or the name of `external`.
    iteration_limit: of the solver, per sample.
    deadline: s, after which a solution is discarded; None waits for it. With one, a run depends on the machine.
    external: a solver of this problem that replaces the named one.
    own: cost and constraints that the user stated, in place of those of `problem`; see mpc_own_problem.py.
    """

    feedback: StateFeedback
    problem: MpcProblem
    solver: str = "daqp"
    iteration_limit: int = 200
    deadline: float | None = None
    external: QpSolver | None = field(default=None, repr=False)
    own: Condensed | None = field(default=None, repr=False)
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
        return {**self.feedback.traces, **{name: self.own_start + i for i, name in enumerate(names)}}

    @cached_property
    def own_start(self) -> int:
        """Length of the feedback's memory, which precedes the MPC's own."""
        return int(self.feedback.initial_memory().size)

    @property
    def _largest_change(self) -> float:
        """Largest change of the current per sample [A]; 0 for any."""
        return (self.problem.limits.current_rate or 0.0) * self.feedback.model.sample_time

    @property
    def multipliers(self) -> slice:
        """Places of the multipliers in memory."""
        start = self.own_start + _PLAN + len(self.condensed.F)
        return slice(start, start + self.condensed.lower.size)

    @cached_property
    def condensed(self) -> Condensed:
        return condense(self.problem) if self.own is None else self.own

    @property
    def slacks(self) -> int:
        """Slacks of soft limits among the unknowns; a problem of the user's has none that are known as such."""
        return len(self.problem.limits.soft) if self.own is None else 0

    @cached_property
    def qp(self) -> QpSolver:
        if self.external is not None:
            return self.external
        return QP_SOLVERS[self.solver].make(self.condensed.H, self.condensed.G, self.iteration_limit, self.deadline)

    @property
    def matrices(self) -> dict[str, np.ndarray]:
        """The matrices at the end of the settings, in their order."""
        c, model = self.condensed, self.feedback.model
        shrink = 1.0 / np.r_[model.scale, model.disturbance_scale]
        return {"shrink": shrink, "F": c.F, "T": c.T, "lower": c.lower, "upper": c.upper}

    def settings_with(self, matrices: Mapping[str, np.ndarray]) -> np.ndarray:
        """Settings of `pose_problem` with these matrices."""
        feedback, c = self.feedback.settings(), self.condensed
        head_size = HEAD + len(matrices) - len(self.matrices)
        begins = head_size + feedback.size + np.cumsum([0, *(part.size for part in matrices.values())])[:-1]
        sizes = self.horizon, len(c.F), c.lower.size, matrices["shrink"].size, c.F.shape[1]
        head = [head_size, self.own_start, self.problem.current_limit, self._largest_change, *sizes]
        head += [*begins[: len(self.matrices)], self.slacks, *begins[len(self.matrices) :]]
        return np.concatenate([np.array(head, dtype=float), feedback, *(part.ravel("F") for part in matrices.values())])

    @cached_property
    def _settings(self) -> np.ndarray:
        return self.settings_with(self.matrices)

    def __getstate__(self) -> dict[str, Any]:
        """Without the solver's workspace, which can't be pickled; another process creates its own."""
        return {name: value for name, value in self.__dict__.items() if name != "qp"}

    def settings(self) -> np.ndarray:
        return self._settings

    def initial_memory(self) -> np.ndarray:
        v, parameters = self.condensed.F.shape
        own = np.zeros(_PLAN + 3 * v + 3 * self.condensed.lower.size + parameters)
        own[_AGE] = 2.0  # no plan yet
        return np.concatenate([self.feedback.initial_memory(), own])

    def linear(self) -> control.StateSpace:
        """The law without active limits: the regulator's. Raises InputError for a cost that the user stated."""
        if self.own is not None:
            raise InputError("an MPC with a problem of your own has no linear law to analyse")
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
        """One sample; arguments as in `pose_problem`."""
        functions, own = _compiled(), memory[self.own_start :]
        plan, multipliers = own[_PLAN:][: len(self.condensed.F)], memory[self.multipliers]
        begin = perf_counter()
        target = functions.begin_sample_of_arrays(reference, measured, memory, settings, float(extra), float(hold))
        reason, solution = self.solve_posed(memory, plan, multipliers)
        own[_ITERATIONS], own[_TIME] = solution.iterations, perf_counter() - begin
        own[_REASON] = self.reason_in_time(reason, own[_TIME])
        if own[_REASON] == SOLVED:
            plan[:], multipliers[:] = solution.x, solution.y
        return float(functions.end_sample_of_arrays(reference, memory, settings, float(extra), target))

    def solve_posed(self, memory: np.ndarray, plan: np.ndarray, multipliers: np.ndarray) -> tuple[float, QpSolution]:
        """Reason and solution of the problem that `pose_problem` wrote; plan and multipliers are the warm start."""
        (v, parameters), bounds = self.condensed.F.shape, self.condensed.lower.size
        problem = memory[self.own_start + _PLAN + 2 * v + bounds + parameters :]
        f, lower, upper = problem[:v], problem[v : v + bounds], problem[v + bounds : v + 2 * bounds]
        solution = self.qp.solve(f, lower, upper, plan, multipliers)
        reason = float(solution.status)
        if reason == SOLVED and not isfinite(solution.x[0]):
            reason = 3.0
        return reason, solution

    def reason_in_time(self, reason: float, seconds: float) -> float:
        """The reason, or that the deadline has passed."""
        return 4.0 if reason == SOLVED and self.deadline is not None and seconds > self.deadline else reason

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        horizon = f"{self.horizon} samples ({self.horizon * self.feedback.model.sample_time:g} s)"
        if self.own is not None:
            size = f"{len(self.own.F)} unknowns, {len(self.own.G)} constraints"
            return f"MPC over {horizon} with a cost and constraints of your own ({size}) by {self.solver}"
        limits = [drive_limit(self.problem.current_limit, unit)]
        if self.problem.limits.current_rate is not None:
            limits.append(drive_limit(self.problem.limits.current_rate, unit, rate=True))
        units = {"speed": "rad/s", "pressure": "Pa", "position": "m"}
        limits += [
            f"|{signal}| <= {limit:g} {units[signal]} (soft)" for signal, limit in self.problem.limits.soft.items()
        ]
        return f"MPC over {horizon} by {self.solver}, {', '.join(limits)}; without them {self.feedback}"


def solve_embedded(
    own: np.ndarray, settings: np.ndarray, plan: np.ndarray, multipliers: np.ndarray, work: np.ndarray
) -> float:
    """Solve the problem that `pose_problem` wrote, as in exported code; returns the reason.

    own: the MPC's part of the memory. settings: as in `mpc_law`. plan: gets the solution. multipliers: warm start and
    result. work: of `solve_qp`.
    """
    unknowns, bounds, size = int(settings[5]), int(settings[6]), int(settings[8])
    root, rows, limit = int(settings[15]), int(settings[16]), int(settings[17])
    z = own[_PLAN + unknowns + bounds :]
    f = z[unknowns + size :]
    lower = f[unknowns:]
    upper = lower[bounds:]
    reason = solve_qp(
        settings[rows:], f, lower, upper, z, multipliers, work, unknowns, bounds,
        int(settings[limit]), settings[limit + 1], settings[limit + 2],
    )  # fmt: skip
    if reason == 0.0:
        multiply(settings[root:], z, unknowns, unknowns, plan)
    return reason


def mpc_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of an MPC with the solver of exported code.

    settings: as in `pose_problem`, with the first indices of three more matrices: root (the solver's unknowns are z
    with theta = root z, and root' F replaces F), the rows of (root, G root), and (limit of iterations, two tolerances)
    of `solve_qp`. memory: as there, with the solver's work space at its end.
    """
    own = memory[int(settings[1]) :]
    unknowns, bounds, size = int(settings[5]), int(settings[6]), int(settings[8])
    plan = own[_PLAN:]
    target = begin_sample(reference, measured, memory, settings, extra, hold)
    work = own[_PLAN + 3 * unknowns + 3 * bounds + size :]
    own[_REASON] = solve_embedded(own, settings, plan, plan[unknowns:], work)
    own[_ITERATIONS] = work[0]
    return end_sample(reference, memory, settings, extra, target)
