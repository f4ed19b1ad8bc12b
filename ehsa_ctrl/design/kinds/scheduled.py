"""Scheduled PID: the controller kind whose gains depend on position, pressure level or load through a table.

Gains are interpolated linearly between the rows of the table and constant beyond its ends. A change of gains causes no
step of the current, because the integral absorbs the change of the proportional part (K. J. Astrom, B. Wittenmark,
"Adaptive Control", 2nd ed. 1995, chapter 9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Array, Definition, In, Second
from ...core.errors import InputError
from ...core.unit import parse
from ..tuning.constraints import Tuning
from ._kind import ControllerKind
from .pid import Gains, Pid, PidDesign, PidGains, PidLoopFile, designed_gains, pid_law

if TYPE_CHECKING:
    import control

#: Scheduling variable -> its code in the settings, SI unit, channels that measure it.
VARIABLES: dict[str, tuple[int, str, tuple[str, ...]]] = {
    "position": (0, "m", ("position",)),
    "level": (1, "Pa", ("p1", "p2")),
    "load": (2, "N", ("force",)),
}
#: States whose rates are proportional to the bulk modulus.
PRESSURES = ("dP", "P_1", "P_2")


class SchedulePoint(Definition):
    """[[schedule.points]]: a value of the variable, with either gains or changes of the linear model."""

    at: str = Field(description='value of the scheduling variable with its unit ("5 bar")')
    gains: PidGains | None = Field(default=None, description="gains at this point, instead of a design")
    stiffness: Annotated[float, In("N/m")] = Field(default=0.0, description="load stiffness, added to the model's")
    mass: Annotated[float, In("kg")] = Field(default=0.0, description="load mass, added to the model's")
    bulk_modulus: Annotated[float, Field(gt=0)] = Field(default=1.0, description="factor on the model's bulk modulus")

    @model_validator(mode="after")
    def _check_gains_or_model(self) -> SchedulePoint:
        if self.gains is not None and (self.stiffness, self.mass, self.bulk_modulus) != (0.0, 0.0, 1.0):
            raise ValueError("a point has either gains or changes of the model (stiffness, mass ...); got both")
        return self

    def model(self, system: control.StateSpace) -> control.StateSpace:
        """The linear model at this point."""
        return operating_point(system, stiffness=self.stiffness, mass=self.mass, bulk_modulus=self.bulk_modulus)


class Schedule(Definition):
    """[schedule]: the scheduling variable, and the points between which the gains are interpolated."""

    variable: Literal["position", "level", "load"] = Field(
        description="scheduling variable: position, level (mean pressure) or load (measured force)"
    )
    filter_time: Second = Field(default=0.05, ge=0, description="time constant of the variable's low-pass filter")
    nominal: str | None = Field(
        default=None, description="value of the variable at which margins are evaluated; by default the middle point"
    )
    points: Annotated[tuple[SchedulePoint, ...], Field(min_length=2), Array] = Field(
        description="two or more, in ascending order"
    )

    @model_validator(mode="after")
    def _check_points(self) -> Schedule:
        values = self.values()
        if not np.all(np.diff(values) > 0):
            raise ValueError(f"the points' values {', '.join(f'{v:g}' for v in values)} must be in ascending order")
        self.value(self.nominal or self.points[0].at)
        return self

    def value(self, text: str) -> float:
        """A value of the variable in its SI unit."""
        try:
            return parse(text, VARIABLES[self.variable][1])
        except InputError as error:
            raise ValueError(f"{self.variable}: {error}") from None

    def values(self) -> list[float]:
        return [self.value(point.at) for point in self.points]


class ScheduledFile(PidLoopFile):
    """A scheduled PID's TOML: a [schedule], and [design] or [tuning] for its points without gains."""

    kind: Literal["scheduled_pid"] = Field(description="type of feedback law")
    schedule: Schedule = Field(description="gain schedule")
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


def scheduled_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample.

    settings: variable (0 position, 1 pressure level, 2 force), coefficient of its filter, rows of the table; b, c,
    current_limit, 1 for conditional integration, sample time; then rows of variable, k_p, k_i, k_d, T_f,
    back-calculation rate. memory: the PID's (5), the variable, k_p of the last sample; the PID's settings (10).
    """
    which, decay, rows = settings[0], settings[1], int(settings[2])
    if which == 0.0:
        value = measured[3]
    elif which == 1.0:
        value = 0.5 * (measured[1] + measured[2])
    else:
        value = measured[4]
    started = memory[3] != 0.0
    memory[5] = decay * memory[5] + (1.0 - decay) * value if started else value
    k = 0
    while k < rows - 2 and memory[5] > settings[8 + 6 * (k + 1)]:
        k += 1
    low = 8 + 6 * k
    share = (memory[5] - settings[low]) / (settings[low + 6] - settings[low])
    share = min(max(share, 0.0), 1.0)
    for j in range(4):
        memory[7 + j] = (1.0 - share) * settings[low + 1 + j] + share * settings[low + 7 + j]
    memory[11], memory[12], memory[13] = settings[3], settings[4], settings[5]
    memory[14] = (1.0 - share) * settings[low + 5] + share * settings[low + 11]
    memory[15], memory[16] = settings[6], settings[7]
    if started and memory[8] != 0.0:
        memory[0] += (memory[6] - memory[7]) * (settings[3] * reference[0] - measured[3])
    memory[6] = memory[7]
    return pid_law(reference, measured, memory[:5], memory[7:17], extra, hold)


@dataclass(frozen=True)
class ScheduledPid:
    """Feedback law of a scheduled PID, a design.controller.Law.

    Attributes
    ----------
    variable: a key of VARIABLES. filter_time: of the variable [s].
    points: ascending values of the variable (n,), n >= 2. pids: the law at each.
    nominal: value of the variable for `linear`.
    """

    variable: str
    filter_time: float
    points: tuple[float, ...]
    pids: tuple[Pid, ...]
    nominal: float
    function = staticmethod(scheduled_law)
    uses: tuple[Callable[..., Any], ...] = (pid_law,)
    compiles = True
    traces = {"integral": 0, "scheduling": 5, "k_p": 6}

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(("position", *VARIABLES[self.variable][2])))

    def settings(self) -> np.ndarray:
        first = self.pids[0]
        decay = exp(-first.sample_time / self.filter_time) if self.filter_time > 0 else 0.0
        common = [float(VARIABLES[self.variable][0]), decay, float(len(self.points))]
        common += [first.b, first.c, first.current_limit, float(first.conditional), first.sample_time]
        rows = [
            [value, pid.gains.k_p, pid.gains.k_i, pid.gains.k_d, pid.gains.T_f, 1.0 / pid.T_t]
            for value, pid in zip(self.points, self.pids, strict=True)
        ]
        return np.concatenate([common, *rows])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(17)

    def at(self, value: float) -> Pid:
        """The fixed PID at this value of the variable."""
        columns = np.array([[p.gains.k_p, p.gains.k_i, p.gains.k_d, p.gains.T_f, 1.0 / p.T_t] for p in self.pids])
        k_p, k_i, k_d, T_f, back = (float(np.interp(value, self.points, column)) for column in columns.T)
        first = self.pids[0]
        T_t = 1.0 / back if back > 0 else float("inf")
        return Pid(
            Gains(k_p, k_i, k_d, T_f), first.b, first.c, first.current_limit, T_t, first.conditional, first.sample_time
        )

    def linear(self) -> control.StateSpace:
        """The fixed PID at `nominal`."""
        return self.at(self.nominal).linear()

    def __str__(self) -> str:
        unit = VARIABLES[self.variable][1]
        rows = "; ".join(f"{value:g} {unit}: {pid.gains}" for value, pid in zip(self.points, self.pids, strict=True))
        return f"PID over {self.variable}, {rows}"


def design_scheduled(name: str, file: ScheduledFile, system: control.StateSpace) -> ScheduledPid:
    """A PID at each point, for the linear model at that operating point.

    Raises InputError for an infeasible [design] or [tuning], with the point.
    """
    schedule, values = file.schedule, file.schedule.values()
    pids = []
    for point in schedule.points:
        try:
            gains = point.gains.parallel() if point.gains is not None else designed_gains(file, point.model(system))
            pids.append(file.law(gains))
        except InputError as error:
            raise InputError(f"[schedule] at {point.at}: {error}") from None
    nominal = values[len(values) // 2] if schedule.nominal is None else schedule.value(schedule.nominal)
    return ScheduledPid(schedule.variable, schedule.filter_time, tuple(values), tuple(pids), nominal)


def operating_point(
    system: control.StateSpace, *, stiffness: float = 0.0, mass: float = 0.0, bulk_modulus: float = 1.0
) -> control.StateSpace:
    """The model with `stiffness` [N/m] and `mass` [kg] added to the load, and another bulk modulus.

    The column of input F_D is the effect of a force on the rod, so that no plant is needed.

    Parameters
    ----------
    system: continuous, states v and x and a pressure, input F_D, as three_state(plant) returns it.
    bulk_modulus: factor on the oil's bulk modulus.

    Raises InputError for a model without these states and this input.
    """
    import control

    states, inputs = list(system.state_labels), list(system.input_labels)
    pressures = [states.index(name) for name in PRESSURES if name in states]
    if not {"v", "x"} <= set(states) or "F_D" not in inputs or not pressures:
        raise InputError(
            f"the model {system.name} has the states {', '.join(states)} and inputs {', '.join(inputs)}; another "
            "operating point needs v, x, a pressure and F_D"
        )
    a, b = np.array(system.A, dtype=float), np.array(system.B, dtype=float)
    v, force = states.index("v"), inputs.index("F_D")
    a[:, states.index("x")] += stiffness * b[:, force]
    share = 1.0 / (1.0 - mass * b[v, force])
    a[v] *= share
    b[v] *= share
    a[pressures] *= bulk_modulus
    b[pressures] *= bulk_modulus
    return control.ss(
        a, b, system.C, system.D, states=states, inputs=inputs, outputs=list(system.output_labels), name=system.name
    )


kind = ControllerKind(
    "scheduled_pid", "position PID with gains over position, pressure level or load", ScheduledFile, design_scheduled
)
