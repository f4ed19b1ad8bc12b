"""The feedback law of a scheduled MPC.

The observer and the regulator are those of the scheduled LQR, whose matrices are interpolated. Each of the up to four
points around the scheduling variables has its quadratic programme, posed from the one estimate, and the plans are
interpolated like the matrices. The limits of the current and of its rate are convex, so that they hold for the
interpolated current as they do for each of the plans; without an active limit the current is the scheduled LQR's.

`ScheduledMpc` runs in Python around its solvers; `scheduled_mpc_law` is the same sample for the export to C.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.loop import LoopAnalysis
from ..qp import SOLVED
from ..review_checks import ReviewContext, ReviewFinding
from ..stages.scheduling import ROW, TAKE_ROW, Schedule, take_row, weigh_corners
from ..state_space.mpc import (
    _ITERATIONS,
    _PLAN,
    _REASON,
    _TIME,
    SAMPLE_FUNCTIONS,
    Mpc,
    apply_plan,
    compile_around_solver,
    pose_problem,
    solve_embedded,
)
from ..state_space.state_feedback import estimate, target_current
from ..words import WordsByUnit
from .scheduled_lqr import ScheduledLqr

if TYPE_CHECKING:
    import control

#: Numbers before the schedule in the settings, and numbers of `weigh_corners`.
HEAD, CORNERS = 8, 8


def begin_scheduled(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, hold: float
) -> float:
    """Interpolate regulator and observer, weigh the points, and estimate; returns Gamma w [A].

    settings: first indices of the schedule (see `take_row`, for rows of the settings of `state_feedback`) and of the
    points' settings (see `pose_problem`), the length of the latter for one point; first indices in memory of the
    schedule, of the weights and of the solutions; number of points; first index of the solver's work space in memory;
    then the schedule and the points' settings.
    memory: as in `pose_problem`, where the plan is the interpolated one; that of `take_row`; weights and indices of the
    four points around; plan and multipliers of each point; the solver's work space in exported code.
    """
    schedule = settings[int(settings[0]) :]
    variables = memory[int(settings[3]) :]
    take_row(measured, variables, schedule)
    weigh_corners(variables, schedule, memory[int(settings[4]) :])
    row = variables[ROW:]
    estimate(measured, memory, row, hold)
    return target_current(reference[0], reference[1], reference[2], memory, row)


def end_scheduled(
    reference: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, target: float
) -> float:
    """Current [A] from the interpolated plan, or from the fallback of `apply_plan`.

    memory, settings: as in `begin_scheduled`; the trace of the reason is 0 if every point around has a new plan.
    """
    point = settings[int(settings[1]) :]
    own = memory[int(point[1]) :]
    unknowns, bounds = int(point[5]), int(point[6])
    corners = memory[int(settings[4]) :]
    solutions = memory[int(settings[5]) :]
    if own[_REASON] == 0.0:
        for i in range(unknowns):
            own[_PLAN + i] = 0.0
        for corner in range(4):
            if corners[corner] > 0.0:
                start = int(corners[4 + corner]) * (unknowns + bounds)
                for i in range(unknowns):
                    own[_PLAN + i] += corners[corner] * solutions[start + i]
    else:
        # An unsolved iterate is no warm start.
        for i in range(int(settings[6]) * (unknowns + bounds)):
            solutions[i] = 0.0
    return apply_plan(reference, memory, point, memory[int(settings[3]) + ROW :], extra, target)


def scheduled_mpc_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample with the solver of exported code; arguments as in `begin_scheduled`, points' settings of `mpc_law`."""
    first, width, places = int(settings[1]), int(settings[2]), int(settings[5])
    own = memory[int(settings[first + 1]) :]
    unknowns = int(settings[first + 5])
    length = unknowns + int(settings[first + 6])
    corners = memory[int(settings[4]) :]
    work = memory[int(settings[7]) :]
    target = begin_scheduled(reference, measured, memory, settings, hold)
    own[_REASON], own[_ITERATIONS] = 0.0, 0.0
    for corner in range(4):
        if corners[corner] > 0.0 and own[_REASON] == 0.0:
            point = first + int(corners[4 + corner]) * width
            place = places + int(corners[4 + corner]) * length
            pose_problem(reference, memory, settings[point:], extra)
            own[_REASON] = solve_embedded(own, settings[point:], memory[place:], memory[place + unknowns :], work)
            own[_ITERATIONS] += work[0]
    return end_scheduled(reference, memory, settings, extra, target)


#: The functions around the solvers, each after those that it calls.
SCHEDULED_FUNCTIONS = (*TAKE_ROW, weigh_corners, *SAMPLE_FUNCTIONS, begin_scheduled, end_scheduled)


@cache
def _compiled() -> Any:
    return compile_around_solver(SCHEDULED_FUNCTIONS, (begin_scheduled, pose_problem, end_scheduled), {"ROW": ROW})


@dataclass(frozen=True)
class ScheduledMpc(WordsByUnit):
    """Feedback law of a scheduled MPC, a design.controller.Law that runs as plain Python around its solvers.

    Attributes
    ----------
    regulator: the law without limits. laws: the MPC at each point.
    """

    regulator: ScheduledLqr
    laws: tuple[Mpc, ...]
    uses = ()
    compiles = False

    @property
    def function(self) -> Any:
        return self.step

    @property
    def schedule(self) -> Schedule:
        return self.regulator.schedule

    @property
    def loops(self) -> dict[str, LoopAnalysis]:
        """Label -> loop of the regulator at the points and half way between neighbours."""
        return self.regulator.loops

    @property
    def reads(self) -> tuple[str, ...]:
        return self.regulator.reads

    @property
    def traces(self) -> Mapping[str, int]:
        start = self._places["schedule"]
        return {**self.laws[0].traces, "scheduling": start + 1, "second_scheduling": start + 2}

    @cached_property
    def _places(self) -> dict[str, int]:
        """First indices of the parts of the memory behind that of an MPC, in their order, and the end."""
        first = self.laws[0]
        solution = len(first.condensed.F) + first.condensed.lower.size
        sizes = {
            "mpc": first.initial_memory().size,
            "schedule": ROW + self.regulator.rows[0].size,
            "corners": CORNERS,
            "solutions": len(self.laws) * solution,
        }
        ends = np.cumsum([0, *sizes.values()]).tolist()
        return dict(zip((*sizes, "end"), ends, strict=True))

    def settings_with(self, points: Sequence[np.ndarray]) -> np.ndarray:
        """Settings of `begin_scheduled` with these settings (width,) of the points."""
        schedule = self.schedule.settings(self.regulator.rows, self.laws[0].model.sample_time)
        places = self._places
        head = [HEAD, HEAD + schedule.size, points[0].size, places["schedule"], places["corners"], places["solutions"]]
        return np.concatenate([np.array([*head, len(points), places["end"]], dtype=float), schedule, *points])

    @cached_property
    def _settings(self) -> np.ndarray:
        return self.settings_with([law.settings() for law in self.laws])

    def settings(self) -> np.ndarray:
        return self._settings

    def initial_memory(self) -> np.ndarray:
        memory = np.zeros(self._places["end"])
        first = self.laws[0].initial_memory()
        memory[: first.size] = first
        return memory

    def linear(self) -> control.StateSpace:
        """The law without active limits at the nominal values of the variables."""
        return self.regulator.linear()

    def findings(self, case: ReviewContext) -> Iterator[ReviewFinding]:
        """What a design review says of the schedule."""
        return self.regulator.findings(case)

    def step(
        self,
        reference: np.ndarray,
        measured: np.ndarray,
        memory: np.ndarray,
        settings: np.ndarray,
        extra: float,
        hold: float,
    ) -> float:
        """One sample; arguments as in `begin_scheduled`."""
        functions, places = _compiled(), self._places
        own = memory[self.laws[0].own_start :]
        begin = perf_counter()
        target = functions.begin_scheduled_of_arrays(reference, measured, memory, settings, float(hold))
        corners = memory[places["corners"] : places["solutions"]]
        solutions = memory[places["solutions"] : places["end"]].reshape(len(self.laws), -1)
        unknowns, width = len(self.laws[0].condensed.F), int(settings[2])
        reason, iterations = float(SOLVED), 0
        for weight, place in zip(corners[:4].tolist(), corners[4:].tolist(), strict=True):
            if weight > 0.0 and reason == SOLVED:
                law, solution = self.laws[int(place)], solutions[int(place)]
                start = int(settings[1]) + int(place) * width
                functions.pose_problem_of_arrays(reference, memory, settings[start : start + width], float(extra))
                reason, found = law.solve_posed(memory, solution[:unknowns], solution[unknowns:])
                iterations += found.iterations
                if reason == SOLVED:
                    solution[:] = *found.x, *found.y
        own[_ITERATIONS], own[_TIME] = iterations, perf_counter() - begin
        own[_REASON] = self.laws[0].reason_in_time(reason, own[_TIME])
        return float(functions.end_scheduled_of_arrays(reference, memory, settings, float(extra), target))

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        points = "; ".join(map(str, self.schedule.points))
        return f"over {self.schedule.names}, interpolated between {points}; at the first: {self.laws[0].words(unit)}"
