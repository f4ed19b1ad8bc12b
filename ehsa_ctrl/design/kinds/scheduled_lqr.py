"""Scheduled LQR: state feedback and Kalman filter that depend on position, pressure level or load through a table.

At each point law and filter are designed on the linear model there; between the points all their matrices are
interpolated. The estimates are in SI units at every point, so that a change of the matrices does not change them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf, sqrt
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from ...core.errors import InputError
from ..analysis.closed_loop import law_state_space
from ..analysis.loop import LoopAnalysis, analyse_loop
from ..analysis.operating_point import operating_point
from ..controller import SampledController
from ..review_checks import MAX_MS, ReviewContext, ReviewFinding
from ..stages.scheduling import ROW, TAKE_ROW, Schedule, SchedulePoint, take_row
from ..state_space.state_feedback import (
    StateFeedback,
    estimate,
    predict,
    regulator_current,
    state_feedback,
    target_current,
)
from ._kind import ControllerKind
from .lqr import StateFeedbackFile, design_state_feedback

if TYPE_CHECKING:
    import control

#: Place of the current limit in the settings of `state_feedback`, of q in its memory.
LIMIT, Q = 3, 1


class ScheduledLqrFile(StateFeedbackFile):
    """A scheduled LQR's TOML: the keys of every state feedback, and a [schedule]."""

    kind: Literal["scheduled_lqr"] = Field(description="type of feedback law")
    schedule: Schedule = Field(description="variables, and points with their changes of the linear model")


def scheduled_lqr_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample.

    settings: size of the memory of `state_feedback`; then those of `take_row` for rows of its settings.
    memory: that of `state_feedback`, gain of the integral at the last sample, then that of `take_row`.
    """
    size = int(settings[0])
    take_row(measured, memory[size + 1 :], settings[1:])
    row = memory[size + 4 :]
    if memory[size] != 0.0 and row[6] != 0.0:
        # The integral's share of the current stays when its gain changes.
        memory[1] *= memory[size] / row[6]
    memory[size] = row[6]
    return state_feedback(reference, measured, memory, row, extra, hold)


@dataclass(frozen=True)
class ScheduledLqr:
    """Feedback law of a scheduled LQR, a design.controller.Law.

    Attributes
    ----------
    schedule: variables and points. laws: the law at each point.
    loops: label -> loop at the points and half way between neighbours, each with the model there.
    """

    schedule: Schedule
    laws: tuple[StateFeedback, ...]
    loops: dict[str, LoopAnalysis] = field(default_factory=dict, repr=False, compare=False)
    function = staticmethod(scheduled_lqr_law)
    uses: tuple[Callable[..., Any], ...] = (
        *TAKE_ROW, target_current, regulator_current, estimate, predict, state_feedback
    )  # fmt: skip
    compiles = True

    @property
    def rows(self) -> list[np.ndarray]:
        return [law.settings() for law in self.laws]

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.laws[0].reads, *self.schedule.reads)))

    @property
    def traces(self) -> dict[str, int]:
        size = self.laws[0].initial_memory().size
        return {**self.laws[0].traces, "scheduling": size + 2, "second_scheduling": size + 3}

    def settings(self) -> np.ndarray:
        first = self.laws[0]
        size = float(first.initial_memory().size)
        return np.concatenate([[size], self.schedule.settings(self.rows, first.model.sample_time)])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(self.laws[0].initial_memory().size + 1 + ROW + self.rows[0].size)

    def at(self, value: float, second: float = 0.0) -> FixedStateFeedback:
        """The fixed law at values of the variables."""
        return FixedStateFeedback(self.schedule.row_at(self.rows, value, second), self.laws[0])

    def linear(self) -> control.StateSpace:
        """The fixed law at the nominal values."""
        return self.at(*self.schedule.nominal_values()).linear()

    def findings(self, case: ReviewContext) -> Iterator[ReviewFinding]:
        """What a design review says of the schedule: frozen at its points and between them, which assumes that the
        variables change slowly compared with the loop."""
        label, loop = max(self.loops.items(), key=lambda item: item[1].Ms if item[1].stable else inf)
        yield ReviewFinding(
            "schedule",
            f"largest Ms over {len(self.loops)} points and midpoints {loop.Ms:.3g}, at {label}",
            "good" if loop.Ms <= MAX_MS else "warning",
            "add a point there, or lower the gains",
        )

    def __str__(self) -> str:
        gains = "; ".join(
            f"{point}: [{', '.join(f'{gain:.4g}' for gain in law.K)}]"
            for point, law in zip(self.schedule.points, self.laws, strict=True)
        )
        states = ", ".join(self.laws[0].model.states)
        return f"state feedback over {self.schedule.names}, K of {states} at {gains}, with a Kalman filter"


@dataclass(frozen=True)
class FixedStateFeedback:
    """A state feedback with interpolated settings, for its linear analysis; `like` has the same memory."""

    row: np.ndarray
    like: StateFeedback
    function = staticmethod(state_feedback)

    def settings(self) -> np.ndarray:
        return self.row

    def initial_memory(self) -> np.ndarray:
        return self.like.initial_memory()

    def linear(self) -> control.StateSpace:
        row = self.row.copy()
        row[LIMIT] = inf
        return law_state_space(replace(self, row=row), self.like.model.sample_time)


def design_scheduled_lqr(name: str, file: ScheduledLqrFile, system: control.StateSpace) -> ScheduledLqr:
    """The law of a file; errors as of `design_over_schedule`."""
    return design_over_schedule(name, file, file.schedule, system)


def design_over_schedule(
    name: str, file: StateFeedbackFile, schedule: Schedule, system: control.StateSpace
) -> ScheduledLqr:
    """A state feedback at each point, for the linear model at that operating point.

    Raises InputError for a design that fails, with the point, and for a loop that is unstable at a point or between.
    """
    schedule.require_measured(system)
    laws = []
    for point in schedule.points:
        try:
            laws.append(design_state_feedback(name, file, point.model(system)))
        except InputError as error:
            raise InputError(f"[schedule] at {point}: {error}") from None
    law = ScheduledLqr(schedule, tuple(laws))
    loops = {}
    for label, values, model in _places(schedule, system):
        fixed = SampledController(name, "scheduled_lqr", file.sample_time, file.current_limit, law.at(*values))  # type: ignore[arg-type]
        loops[label] = analyse_loop(model, fixed, points=300)
        if not loops[label].stable:
            raise InputError(f"[schedule] the loop is unstable at {label}; add a point there, or lower the gains")
    return replace(law, loops=loops)


def _places(
    schedule: Schedule, system: control.StateSpace
) -> Iterator[tuple[str, tuple[float, float], control.StateSpace]]:
    """Label, variables and model of the points, and half way between neighbours along each variable."""
    first, second = schedule.axes()
    grid = [(x, y) for x in first for y in second]
    points = dict(zip(grid, schedule.points, strict=True))
    for place, point in points.items():
        yield str(point), place, point.model(system)
    pairs = [((x, a), (x, b)) for x in first for a, b in pairwise(second)]
    pairs += [((a, y), (b, y)) for y in second for a, b in pairwise(first)]
    for one, other in pairs:
        middle = (0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1]))
        yield f"the middle of {points[one]} and {points[other]}", middle, _between(points[one], points[other], system)


def _between(one: SchedulePoint, other: SchedulePoint, system: control.StateSpace) -> control.StateSpace:
    """The model half way between two points: means, of the bulk modulus the geometric one."""
    return operating_point(
        system,
        stiffness=0.5 * (one.stiffness + other.stiffness),
        mass=0.5 * (one.mass + other.mass),
        bulk_modulus=sqrt(one.bulk_modulus * other.bulk_modulus),
    )


kind = ControllerKind(
    "scheduled_lqr",
    "state feedback and Kalman filter over position, pressure level or load",
    ScheduledLqrFile,
    design_scheduled_lqr,
)
