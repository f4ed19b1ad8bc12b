"""Scheduled PID: the controller kind whose gains depend on position, pressure level or load through a table.

A change of gains causes no step of the current, because the integral absorbs the change of the proportional part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Array
from ...core.errors import InputError
from ..stages.scheduling import TAKE_ROW, Schedule, SchedulePoint, take_row
from ..tuning.constraints import Tuning
from ..words import WordsByUnit
from ._kind import ControllerKind
from .pid import Gains, Pid, PidDesign, PidGains, PidLoopFile, designed_gains, pid_law

if TYPE_CHECKING:
    import control


class PidPoint(SchedulePoint):
    """[[schedule.points]]: values of the variables, with either gains or changes of the linear model."""

    gains: PidGains | None = Field(default=None, description="gains at this point, instead of a design")

    @model_validator(mode="after")
    def _check_gains_or_model(self) -> PidPoint:
        if self.gains is not None and (self.stiffness, self.mass, self.bulk_modulus) != (0.0, 0.0, 1.0):
            raise ValueError("a point has either gains or changes of the model (stiffness, mass ...); got both")
        return self


class PidSchedule(Schedule):
    """[schedule]: the scheduling variables, and the points between which the gains are interpolated."""

    points: Annotated[tuple[PidPoint, ...], Field(min_length=2), Array] = Field(
        description="two or more, in ascending order"
    )


class ScheduledFile(PidLoopFile):
    """A scheduled PID's TOML: a [schedule], and [design] or [tuning] for its points without gains."""

    kind: Literal["scheduled_pid"] = Field(description="type of feedback law")
    schedule: PidSchedule = Field(description="gain schedule")
    design: PidDesign | None = Field(
        default=None, description="crossover and phase margin; this or [tuning] for points without gains"
    )
    tuning: Tuning | None = Field(
        default=None, description="optimised gains; this or [design] for points without gains"
    )

    @model_validator(mode="after")
    def _check_tables(self) -> ScheduledFile:
        methods = (self.design is not None) + (self.tuning is not None)
        needed = any(point.gains is None for point in self.schedule.points)
        if methods != int(needed):
            raise ValueError(
                "points without gains need one table, either [design] or [tuning]"
                if needed
                else "every point has gains; remove [design] and [tuning]"
            )
        return self


def scheduled_pid_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample.

    settings: b, c, current_limit, 1 for conditional integration, sample time; then those of `take_row` for rows of k_p,
    k_i, k_d, T_f, back-calculation rate. memory: the PID's (5), k_p of the last sample, the PID's settings (10); then
    that of `take_row`.
    """
    started = memory[3] != 0.0
    take_row(measured, memory[16:], settings[5:])
    row = memory[19:]
    memory[6:10] = row[0:4]
    memory[10], memory[11], memory[12], memory[13] = settings[0], settings[1], settings[2], row[4]
    memory[14], memory[15] = settings[3], settings[4]
    if started and memory[7] != 0.0:
        memory[0] += (memory[5] - memory[6]) * (settings[0] * reference[0] - measured[3])
    memory[5] = memory[6]
    return pid_law(reference, measured, memory[:5], memory[6:16], extra, hold)


@dataclass(frozen=True)
class ScheduledPid(WordsByUnit):
    """Feedback law of a scheduled PID, a design.controller.Law.

    Attributes
    ----------
    schedule: variables and points. pids: the law at each point.
    """

    schedule: Schedule
    pids: tuple[Pid, ...]
    function = staticmethod(scheduled_pid_law)
    uses: tuple[Callable[..., Any], ...] = (*TAKE_ROW, pid_law)
    compiles = True
    traces = {"integral": 0, "k_p": 5, "scheduling": 17, "second_scheduling": 18}

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(("position", *self.schedule.reads)))

    @property
    def rows(self) -> list[np.ndarray]:
        """k_p, k_i, k_d, T_f, back-calculation rate at each point."""
        return [np.array([*vars(pid.gains).values(), 1.0 / pid.T_t]) for pid in self.pids]

    def settings(self) -> np.ndarray:
        first = self.pids[0]
        common = [first.b, first.c, first.current_limit, float(first.conditional), first.sample_time]
        return np.concatenate([common, self.schedule.settings(self.rows, first.sample_time)])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(24)

    def at(self, value: float, second: float = 0.0) -> Pid:
        """The fixed PID at values of the variables."""
        k_p, k_i, k_d, T_f, back = (float(number) for number in self.schedule.row_at(self.rows, value, second))
        first = self.pids[0]
        T_t = 1.0 / back if back > 0 else float("inf")
        return Pid(
            Gains(k_p, k_i, k_d, T_f), first.b, first.c, first.current_limit, T_t, first.conditional, first.sample_time
        )

    def linear(self) -> control.StateSpace:
        """The fixed PID at the nominal values."""
        return self.at(*self.schedule.nominal_values()).linear()

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        points = zip(self.schedule.points, self.pids, strict=True)
        rows = "; ".join(f"{point}: {pid.gains.words(unit)}" for point, pid in points)
        return f"PID over {self.schedule.names}, {rows}"


def design_scheduled(name: str, file: ScheduledFile, system: control.StateSpace) -> ScheduledPid:
    """A PID at each point, for the linear model at that operating point.

    Raises InputError for an infeasible [design] or [tuning], with the point.
    """
    file.schedule.require_measured(system)
    pids = []
    for point in file.schedule.points:
        try:
            gains = point.gains.parallel() if point.gains is not None else designed_gains(file, point.model(system))
            pids.append(file.law(gains))
        except InputError as error:
            raise InputError(f"[schedule] at {point}: {error}") from None
    return ScheduledPid(file.schedule, tuple(pids))


kind = ControllerKind(
    "scheduled_pid", "position PID with gains over position, pressure level or load", ScheduledFile, design_scheduled
)
