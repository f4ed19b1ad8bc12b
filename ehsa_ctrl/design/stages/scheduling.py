"""Gain scheduling: the table of a [schedule], and the row that a law takes from it at each sample.

The rows are interpolated linearly between the points, bilinearly with two variables, and constant beyond the ends. The
variables are low-pass filtered, because a schedule that follows fast signals is feedback (K. J. Astrom, B. Wittenmark,
"Adaptive Control", 2nd ed. 1995, chapter 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Array, Definition, In, Second
from ...core.errors import InputError
from ...core.unit import parse
from ..analysis.operating_point import PRESSURES, operating_point
from ..analysis.sampled import drive_unit_of

if TYPE_CHECKING:
    import control

Variable = Literal["position", "level", "load"]
#: Scheduling variable -> its code in the settings, SI unit, channels that measure it.
VARIABLES: dict[str, tuple[int, str, tuple[str, ...]]] = {
    "position": (0, "m", ("position",)),
    "level": (1, "Pa", ("p1", "p2")),
    "load": (2, "N", ("force",)),
}
#: Numbers before the row in the memory of `take_row`.
ROW = 3


class SchedulePoint(Definition):
    """[[schedule.points]]: values of the variables, with changes of the linear model."""

    at: str = Field(description='value of the scheduling variable with its unit ("5 bar")')
    second_at: str | None = Field(default=None, description="value of the second variable, if there is one")
    stiffness: Annotated[float, In("N/m")] = Field(default=0.0, description="load stiffness, added to the model's")
    mass: Annotated[float, In("kg")] = Field(default=0.0, description="load mass, added to the model's")
    bulk_modulus: Annotated[float, Field(gt=0)] = Field(default=1.0, description="factor on the model's bulk modulus")

    def model(self, system: control.StateSpace) -> control.StateSpace:
        """The linear model at this point."""
        return operating_point(system, stiffness=self.stiffness, mass=self.mass, bulk_modulus=self.bulk_modulus)

    def __str__(self) -> str:
        return self.at if self.second_at is None else f"{self.at}, {self.second_at}"


class Schedule(Definition):
    """[schedule]: the scheduling variables, and the points between which the law is interpolated."""

    variable: Variable = Field(
        description="scheduling variable: position, level (mean pressure) or load (measured force)"
    )
    second_variable: Variable | None = Field(
        default=None,
        description="another one; the points then are a grid, with every value of one at every value of the other",
    )
    filter_time: Second = Field(default=0.05, ge=0, description="time constant of the variables' low-pass filter")
    nominal: str | None = Field(
        default=None, description="value of the variable at which margins are evaluated; by default the middle point"
    )
    second_nominal: str | None = Field(default=None, description="the same of the second variable")
    points: Annotated[tuple[SchedulePoint, ...], Field(min_length=2), Array] = Field(
        description="two or more, in ascending order"
    )

    @model_validator(mode="after")
    def _check_points(self) -> Schedule:
        if self.second_variable == self.variable:
            raise ValueError(f"second_variable = {self.variable!r} is the variable itself; name another one")
        for point in self.points:
            if (point.second_at is None) != (self.second_variable is None):
                raise ValueError(
                    f"the point at {point.at} has {'no' if point.second_at is None else 'a'} second_at, the schedule "
                    f"{'no' if self.second_variable is None else 'a'} second_variable; give both or neither"
                )
        first, second = self.axes()
        if self.second_variable is not None and min(len(first), len(second)) < 2:
            raise ValueError("a grid of two variables needs at least two values of each; leave out the other one")
        for values in (first, second):
            if not np.all(np.diff(values) > 0):
                listed = ", ".join(f"{v:g}" for v in values)
                raise ValueError(f"the points' values {listed} must be in ascending order")
        found = [(self._value(p.at), self._second(p.second_at)) for p in self.points]
        if found != [(x, y) for x in first for y in second]:
            raise ValueError(
                f"the {len(found)} points are no grid in order: expected all {len(second)} values of second_at at the "
                f"first value of at, then all at the next, {len(first) * len(second)} points"
            )
        self.nominal_values()
        return self

    def require_measured(self, system: control.StateSpace) -> None:
        """Raise InputError for a variable that the plant of the linear model `system` does not measure."""
        has_oil, unit = bool(set(PRESSURES) & set(system.output_labels)), drive_unit_of(system)
        for variable in (self.variable, self.second_variable):
            if variable == "level" and not has_oil:
                raise InputError(
                    f"[schedule] the model {system.name} has no pressures, so that no level is measured; take variable "
                    '= "position"'
                )
            if variable == "load" and unit != "A":
                raise InputError(
                    f"[schedule] the plant of {system.name} has no load cell, so that no load is measured; take "
                    'variable = "position"'
                )

    def _value(self, text: str) -> float:
        return _parse(text, self.variable)

    def _second(self, text: str | None) -> float:
        return 0.0 if text is None or self.second_variable is None else _parse(text, self.second_variable)

    def axes(self) -> tuple[list[float], list[float]]:
        """Values of both variables in their order, SI units; a single 0 without a second one."""
        first, second = [self._value(p.at) for p in self.points], [self._second(p.second_at) for p in self.points]
        # With one variable a repeated value is a mistake, with two it is the grid.
        return (first if self.second_variable is None else list(dict.fromkeys(first))), list(dict.fromkeys(second))

    def nominal_values(self) -> tuple[float, float]:
        """Where margins are evaluated."""
        first, second = self.axes()
        given = first[len(first) // 2] if self.nominal is None else self._value(self.nominal)
        other = second[len(second) // 2] if self.second_nominal is None else self._second(self.second_nominal)
        return given, other

    @property
    def names(self) -> str:
        """The variables in words."""
        return self.variable if self.second_variable is None else f"{self.variable} and {self.second_variable}"

    @property
    def reads(self) -> tuple[str, ...]:
        """Channels that measure the variables."""
        second = VARIABLES[self.second_variable][2] if self.second_variable else ()
        return (*VARIABLES[self.variable][2], *second)

    def settings(self, rows: Sequence[np.ndarray], sample_time: float) -> np.ndarray:
        """Settings of `take_row` for a row (width,) at each point."""
        first, second = self.axes()
        decay = exp(-sample_time / self.filter_time) if self.filter_time > 0 else 0.0
        codes = [float(VARIABLES[word][0]) if word else -1.0 for word in (self.variable, self.second_variable)]
        head = [*codes, decay, float(len(first)), float(len(second)), float(rows[0].size)]
        return np.concatenate([head, first, second, *rows])

    def row_at(self, rows: Sequence[np.ndarray], value: float, second: float = 0.0) -> np.ndarray:
        """The interpolated row (width,) at values of the variables."""
        memory, settings = np.zeros(ROW + rows[0].size), self.settings(rows, 1.0)
        memory[1], memory[2] = value, second
        mix_rows(memory, settings)
        return memory[ROW:]


def _parse(text: str, variable: str) -> float:
    """A value of a variable in its SI unit."""
    try:
        return parse(text, VARIABLES[variable][1])
    except InputError as error:
        raise ValueError(f"{variable}: {error}") from None


def scheduling_variable(code: float, measured: np.ndarray) -> float:
    """Value of the variable with this code: 0 position [m], 1 pressure level [Pa], 2 force [N]."""
    if code == 0.0:
        return measured[3]
    if code == 1.0:
        return 0.5 * (measured[1] + measured[2])
    return measured[4]


def lower_point(value: float, axis: np.ndarray, count: int) -> int:
    """Index of the point below a value, at most the last but one."""
    k = 0
    while k < count - 2 and value > axis[k + 1]:
        k += 1
    return k


def share_above(value: float, axis: np.ndarray, k: int) -> float:
    """Share, 0 to 1, that point k + 1 has in the interpolation between it and point k."""
    return min(max((value - axis[k]) / (axis[k + 1] - axis[k]), 0.0), 1.0)


def mix_rows(memory: np.ndarray, settings: np.ndarray) -> None:
    """Interpolate the rows at the variables memory[1], memory[2] to memory[3:]; settings as of `take_row`."""
    first, second, width = int(settings[3]), int(settings[4]), int(settings[5])
    axis, other = settings[6:], settings[6 + first :]
    table = settings[6 + first + second :]
    i = lower_point(memory[1], axis, first)
    share = share_above(memory[1], axis, i)
    j, part, after = 0, 0.0, 0
    if second > 1:
        j = lower_point(memory[2], other, second)
        part = share_above(memory[2], other, j)
        after = width
    low, high = (i * second + j) * width, ((i + 1) * second + j) * width
    for m in range(width):
        # In this form equal rows stay equal to the bit: a row may contain sizes and indices.
        here = table[low + m] + share * (table[high + m] - table[low + m])
        there = table[low + after + m] + share * (table[high + after + m] - table[low + after + m])
        memory[3 + m] = here + part * (there - here)


def weigh_corners(memory: np.ndarray, settings: np.ndarray, corners: np.ndarray) -> None:
    """Write the weights of the four points around the variables in memory, then their indices, to corners (8,).

    memory, settings: as of `take_row`. Points that do not count have weight 0.
    """
    first, second = int(settings[3]), int(settings[4])
    axis, other = settings[6:], settings[6 + first :]
    i = lower_point(memory[1], axis, first)
    share = share_above(memory[1], axis, i)
    j, part = 0, 0.0
    if second > 1:
        j = lower_point(memory[2], other, second)
        part = share_above(memory[2], other, j)
    low, high = i * second + j, (i + 1) * second + j
    corners[0], corners[1] = (1.0 - share) * (1.0 - part), share * (1.0 - part)
    corners[2], corners[3] = (1.0 - share) * part, share * part
    corners[4], corners[5], corners[6], corners[7] = float(low), float(high), float(low + 1), float(high + 1)


def take_row(measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> None:
    """One sample: filter the variables and write the interpolated row to memory[3:].

    settings: codes of the variables (-1: none), coefficient of their filter, number of values of each, width of a row;
    these values; the rows. memory: 1 after the first sample, both variables, the row.
    """
    for which in range(2):
        if settings[which] >= 0.0:
            value = scheduling_variable(settings[which], measured)
            if memory[0] == 0.0:
                memory[1 + which] = value
            else:
                memory[1 + which] = settings[2] * memory[1 + which] + (1.0 - settings[2]) * value
    memory[0] = 1.0
    mix_rows(memory, settings)


#: Functions of `take_row`, each after those that it calls.
TAKE_ROW = (scheduling_variable, lower_point, share_above, mix_rows, take_row)
