"""Scheduled PID: gains over position, pressure level or load, for where one set of gains falls short."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Array, Definition, In, Second
from ...core.errors import InputError
from ...core.unit import parse
from ..laws.pid_forms import Gains
from ..laws.scheduled import VARIABLES, ScheduledPid
from ..synthesis.altered import altered
from ..tuning.pid_files import PidDesign, PidGains, classic_gains
from ..tuning.tune import Tuning
from ._kind import ControllerKind
from .pid import PidLoopFile, tuned

if TYPE_CHECKING:
    import control


class Point(Definition):
    """[[schedule.points]]: a value of the variable, and either the gains there or how the linear model differs."""

    at: str = Field(description='value of the scheduling variable with its unit ("5 bar")')
    gains: PidGains | None = Field(default=None, description="gains at this point, instead of a design")
    stiffness: Annotated[float, In("N/m")] = Field(default=0.0, description="load stiffness, added to the model's")
    mass: Annotated[float, In("kg")] = Field(default=0.0, description="load mass, added to the model's")
    bulk_modulus: Annotated[float, Field(gt=0)] = Field(default=1.0, description="factor on the model's bulk modulus")

    @model_validator(mode="after")
    def _fit(self) -> Point:
        if self.gains is not None and (self.stiffness, self.mass, self.bulk_modulus) != (0.0, 0.0, 1.0):
            raise ValueError("a point has either gains or changes of the model (stiffness, mass, bulk_modulus)")
        return self


class Schedule(Definition):
    """[schedule]: over what the gains change, and the points between which they are interpolated."""

    variable: Literal["position", "level", "load"] = Field(
        description="scheduling variable: position, level (mean pressure) or load (measured force)",
    )
    filter_time: Second = Field(default=0.05, description="time constant of the variable's low-pass filter")
    nominal: str | None = Field(
        default=None,
        description="value of the variable at which margins are evaluated; left out, the middle point",
    )
    points: Annotated[tuple[Point, ...], Field(min_length=2), Array] = Field(
        description="two or more, in ascending order",
    )

    @model_validator(mode="after")
    def _rising(self) -> Schedule:
        values = self.values()
        if not np.all(np.diff(values) > 0):
            raise ValueError(f"the points' values {', '.join(f'{v:g}' for v in values)} must rise from one to the next")
        if self.filter_time < 0:
            raise ValueError("filter_time must be at least 0 s")
        self.value(self.nominal or self.points[0].at)
        return self

    def value(self, text: str) -> float:
        try:
            return parse(text, VARIABLES[self.variable][1])
        except InputError as error:
            raise ValueError(f"{self.variable}: {error}") from None

    def values(self) -> list[float]:
        return [self.value(point.at) for point in self.points]


class ScheduledFile(PidLoopFile):
    """A scheduled PID's TOML: the [schedule], and [design] or [tuning] for points that have no gains of their own."""

    kind: Literal["scheduled_pid"] = Field(description="type of feedback law")
    schedule: Schedule = Field(description="gain schedule")
    design: PidDesign | None = Field(
        default=None,
        description="crossover and phase margin; this or [tuning] where points have no gains of their own",
    )
    tuning: Tuning | None = Field(
        default=None,
        description="optimised gains; this or [design] where points have no gains of their own",
    )

    @model_validator(mode="after")
    def _one(self) -> ScheduledFile:
        ways = (self.design is not None) + (self.tuning is not None)
        needed = any(point.gains is None for point in self.schedule.points)
        if ways != int(needed):
            raise ValueError(
                "points without gains need one table, [design] or [tuning]"
                if needed
                else "every point has gains; leave [design] and [tuning] out"
            )
        return self


def design_scheduled(name: str, file: ScheduledFile, system: control.StateSpace) -> ScheduledPid:
    """A PID at each point, for the linear model as it is there.

    Raises InputError: a point whose [design] or [tuning] can't be reached; says which.
    """
    schedule, values = file.schedule, file.schedule.values()
    pids = []
    for point in schedule.points:
        try:
            pids.append(file.law(_gains(file, point, system)))
        except InputError as error:
            raise InputError(f"[schedule] at {point.at}: {error}") from None
    nominal = values[len(values) // 2] if schedule.nominal is None else schedule.value(schedule.nominal)
    return ScheduledPid(schedule.variable, schedule.filter_time, tuple(values), tuple(pids), nominal)


def _gains(file: ScheduledFile, point: Point, system: control.StateSpace) -> Gains:
    if point.gains is not None:
        return point.gains.parallel()
    there = altered(system, stiffness=point.stiffness, mass=point.mass, bulk_modulus=point.bulk_modulus)
    if file.design is not None:
        return classic_gains(file.design, there, file.sample_time)
    assert file.tuning is not None
    weights = file.reference_weight, file.derivative_reference_weight
    return tuned(there, file.tuning, file.sample_time, *weights).gains


kind = ControllerKind(
    "scheduled_pid", "position PID with gains over position, pressure level or load", ScheduledFile, design_scheduled
)
