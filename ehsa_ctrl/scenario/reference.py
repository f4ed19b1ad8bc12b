"""Rod position references, one class per kind: the signal, its jumps and its holds; and a force target beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from ..core.definition import Definition, Hertz, In, Metre, Second
from ..core.errors import InputError
from .force_reference import ForceChange, ForceLevels

#: Start and end of a hold [s].
Hold = tuple[float, float]
MetrePerSecond = Annotated[float, In("m/s")]
MetrePerSecond2 = Annotated[float, In("m/s2")]


class _ReferenceBase(Definition):
    """Base of the reference kinds; by default the target neither jumps nor holds."""

    kind: str = Field(description="type of reference")
    force: ForceLevels | None = Field(
        default=None,
        description="force target beside the position, for a controller that follows one; none if left out",
    )

    def rows(self, time: np.ndarray) -> np.ndarray:
        """Reference of a run: `signal`, with the force target [N] as fourth column (N, 4) if there is one."""
        motion = self.signal(time)
        return motion if self.force is None else np.column_stack([motion, self.force.signal(time)])

    def force_changes(self) -> list[ForceChange]:
        """Changes of the force target; empty without one."""
        return [] if self.force is None else self.force.changes()

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Position [m], speed [m/s] and acceleration [m/s2] at the times (N,) as (N, 3).

        Speed and acceleration leave out the impulses at jumps of the position or speed.
        """
        raise NotImplementedError

    def jumps(self) -> list[float]:
        """Times at which the target jumps [s]."""
        return []

    def holds(self) -> list[Hold]:
        """Intervals in which the target is constant [s]; the last one lasts to the end of the run."""
        return []


class _Targets(_ReferenceBase):
    """A sequence of targets, each with its start time."""

    times: list[Second] = Field(description="start time of each motion")
    positions: list[Metre] = Field(description="target position of each motion")

    @model_validator(mode="after")
    def _check_lengths(self) -> _Targets:
        if not self.times or len(self.times) != len(self.positions):
            raise ValueError(
                f"times has {len(self.times)} and positions {len(self.positions)} entries; give one position per time"
            )
        return self

    def holds(self) -> list[Hold]:
        return list(zip(self._ends(), [*self.times[1:], np.inf], strict=True))

    def _ends(self) -> list[float]:
        """Time at which each target is reached [s]."""
        return self.times


class Steps(_Targets):
    """Steps from mid-stroke, x = 0."""

    kind: Literal["steps"] = Field(description="type of reference")
    times: list[Second] = Field(description="times of the steps")
    positions: list[Metre] = Field(description="target position after each step")

    @model_validator(mode="after")
    def _check_times(self) -> Steps:
        if np.any(np.diff(self.times) <= 0) or self.times[0] < 0:
            raise ValueError("times must increase and be at least 0 s")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        values = np.zeros((time.size, 3))
        for at, position in zip(self.times, self.positions, strict=True):
            values[time >= at - 1e-9, 0] = position
        return values

    def jumps(self) -> list[float]:
        """Times at which the target jumps [s]; a repeated target is not a jump."""
        return [at for at, size in zip(self.times, np.diff([0.0, *self.positions]), strict=True) if size != 0.0]


class Moves(_Targets):
    """Quintic moves from rest to rest.

    s(t) = 10 t^3 - 15 t^4 + 6 t^5 starts and ends with zero speed and acceleration.
    """

    kind: Literal["moves"] = Field(description="type of reference")
    durations: list[Second] = Field(description="duration of each motion, which must end before the next one starts")

    @model_validator(mode="after")
    def _check_moves(self) -> Moves:
        if len(self.times) != len(self.durations):
            raise ValueError(
                f"times, positions and durations have {len(self.times)}, {len(self.positions)} and "
                f"{len(self.durations)} entries; give the same number of each"
            )
        ends = [0.0, *self._ends()]
        if min(self.durations) <= 0 or any(at < end for at, end in zip(self.times, ends, strict=False)):
            raise ValueError("every move must take more than 0 s and end before the next one starts")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        values = np.zeros((time.size, 3))
        start = 0.0
        for at, position, duration in zip(self.times, self.positions, self.durations, strict=True):
            s = np.clip((time - at) / duration, 0.0, 1.0)
            travel = position - start
            values[:, 0] += travel * s**3 * (10 - 15 * s + 6 * s**2)
            values[:, 1] += travel / duration * 30 * s**2 * (1 - s) ** 2
            values[:, 2] += travel / duration**2 * 60 * s * (1 - s) * (1 - 2 * s)
            start = position
        return values

    def _ends(self) -> list[float]:
        return [at + duration for at, duration in zip(self.times, self.durations, strict=True)]


class Sine(_ReferenceBase):
    """amplitude sin(2 pi frequency (t - start)); zero before `start`."""

    kind: Literal["sine"] = Field(description="type of reference")
    amplitude: Metre = Field(description="amplitude")
    frequency: Hertz = Field(description="frequency")
    start: Second = Field(default=0.0, description="start time")

    @model_validator(mode="after")
    def _check_values(self) -> Sine:
        if self.frequency <= 0 or self.start < 0:
            raise ValueError("frequency must be greater than 0 Hz and start at least 0 s")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        w = 2 * np.pi * self.frequency
        t = time - self.start
        on = t >= 0
        columns = [np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)]
        return self.amplitude * np.column_stack(columns) * on[:, None]


class Ramp(_ReferenceBase):
    """From zero to a position at constant speed, then a hold; the speed jumps at both ends."""

    kind: Literal["ramp"] = Field(description="type of reference")
    position: Metre = Field(description="final position")
    velocity: MetrePerSecond = Field(description="magnitude of the velocity")
    start: Second = Field(default=0.0, description="start time")

    @model_validator(mode="after")
    def _check_values(self) -> Ramp:
        if self.velocity <= 0 or self.start < 0 or self.position == 0:
            raise ValueError("velocity must be greater than 0 m/s, start at least 0 s and position not 0 m")
        return self

    @property
    def end(self) -> float:
        """Time at which the ramp ends [s]."""
        return self.start + abs(self.position) / self.velocity

    def signal(self, time: np.ndarray) -> np.ndarray:
        sign = np.sign(self.position)
        values = np.zeros((time.size, 3))
        values[:, 0] = sign * np.clip(self.velocity * (time - self.start), 0.0, abs(self.position))
        values[:, 1] = sign * self.velocity * ((time >= self.start - 1e-9) & (time < self.end - 1e-9))
        return values

    def holds(self) -> list[Hold]:
        return [(self.end, np.inf)]


class Trapezoid(_Targets):
    """Moves with a trapezoidal velocity profile.

    Constant acceleration, constant velocity, constant deceleration; a short move never reaches the largest velocity.
    """

    kind: Literal["trapezoid"] = Field(description="type of reference")
    velocity: MetrePerSecond = Field(description="largest velocity")
    acceleration: MetrePerSecond2 = Field(description="largest acceleration")

    @model_validator(mode="after")
    def _check_moves(self) -> Trapezoid:
        if self.velocity <= 0 or self.acceleration <= 0:
            raise ValueError("velocity and acceleration must be greater than 0")
        ends = [0.0, *self._ends()]
        for at, end in zip(self.times, ends, strict=False):
            if at < end:
                raise ValueError(f"the move at {at:g} s starts before the previous one ends, at {end:g} s")
        return self

    def _phases(self, travel: float) -> tuple[float, float]:
        """Durations [s] of the acceleration, which the deceleration equals, and of the constant speed."""
        rise = min(self.velocity / self.acceleration, float(np.sqrt(abs(travel) / self.acceleration)))
        reached = rise * self.acceleration >= self.velocity * (1 - 1e-12)
        return rise, max(abs(travel) / self.velocity - rise, 0.0) if reached else 0.0

    def signal(self, time: np.ndarray) -> np.ndarray:
        values = np.zeros((time.size, 3))
        for at, position, begin in zip(self.times, self.positions, [0.0, *self.positions], strict=False):
            travel = position - begin
            rise, constant = self._phases(travel)
            a, sign, t = self.acceleration, np.sign(travel), np.maximum(time - at, 0.0)
            first, second = np.minimum(t, rise), np.clip(t - rise, 0.0, constant)
            third = np.clip(t - rise - constant, 0.0, rise)
            top = a * rise
            values[:, 0] += sign * (0.5 * a * first**2 + top * second + top * third - 0.5 * a * third**2)
            values[:, 1] += sign * a * (first - third)
            on = time >= at - 1e-12
            values[:, 2] += sign * a * ((on & (t < rise)).astype(float) - ((third > 0) & (third < rise)))
        return values

    def _ends(self) -> list[float]:
        ends = []
        for at, position, begin in zip(self.times, self.positions, [0.0, *self.positions], strict=False):
            rise, constant = self._phases(position - begin)
            ends.append(at + 2 * rise + constant)
        return ends


class TrajectoryFile(_ReferenceBase):
    """A trajectory from a CSV file: t [s], position [m] and, optionally, velocity [m/s] and acceleration [m/s2].

    Values are interpolated linearly; without a velocity column the velocity is the slope of the position. The last
    position is held to the end of the run.
    """

    kind: Literal["file"] = Field(description="type of reference")
    file: str = Field(description="path of the CSV file, relative to the scenario's folder")
    start: Second = Field(default=0.0, description="time in the run at which the file's t = 0 lies")
    period: Second | None = Field(
        default=None, description="time after which the trajectory begins anew; left out, it runs once"
    )
    _table: dict[str, np.ndarray] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo) -> TrajectoryFile:
        folder = (info.context or {}).get("folder")
        path = Path(self.file)
        if folder is not None and (Path(folder) / path).is_file():
            path = Path(folder) / path
        if self.start < 0:
            raise ValueError("start must be at least 0 s")
        try:
            self._table.update(read_trajectory(path))
        except InputError as error:
            raise ValueError(str(error)) from None
        if self.period is not None:
            end, position = self._table["t"][-1], self._table["position"]
            if self.period < end or self.period <= 0:
                raise ValueError(f"period = {self.period:g} s ends before the file, whose last t is {end:g} s")
            if abs(position[-1] - position[0]) > 1e-9:
                raise ValueError(
                    f"a file that is repeated must end where it begins; {path} goes from {position[0]:g} m to "
                    f"{position[-1]:g} m"
                )
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TrajectoryFile) and self.model_dump() == other.model_dump()

    __hash__ = None  # type: ignore[assignment]

    def signal(self, time: np.ndarray) -> np.ndarray:
        table, t = self._table, time - self.start
        if self.period is not None:
            # A tenth of a nanosecond: a sample at the end of a period is the first of the next one.
            t = np.where(t > 0.0, np.mod(t + 1e-10, self.period), t)
        values = np.zeros((time.size, 3))
        values[:, 0] = np.interp(t, table["t"], table["position"])
        within = (t >= table["t"][0] - 1e-9) & (t < table["t"][-1] - 1e-9)
        if "velocity" in table:
            values[:, 1] = np.interp(t, table["t"], table["velocity"]) * within
        else:
            slope = np.diff(table["position"]) / np.diff(table["t"])
            row = np.clip(np.searchsorted(table["t"], t + 1e-9, side="right") - 1, 0, slope.size - 1)
            values[:, 1] = slope[row] * within
        if "acceleration" in table:
            values[:, 2] = np.interp(t, table["t"], table["acceleration"]) * within
        return values

    def holds(self) -> list[Hold]:
        return [(self.start + float(self._table["t"][-1]), np.inf)] if self.period is None else []


def read_trajectory(path: Path) -> dict[str, np.ndarray]:
    """Read the columns of a trajectory file: t, position and, if present, velocity and acceleration; each (N,).

    Raises InputError with file, column and row for a missing or malformed file.
    """
    from ..core.formats import read_table

    table = read_table(path)
    for name in ("t", "position"):
        if name not in table.names:
            raise InputError(f"{path}: has no column {name!r}; expected t [s] and position [m]")
    known = ("t", "position", "velocity", "acceleration")
    columns = {name: table.numbers(name) for name in known if name in table.names}
    time = columns["t"]
    if time.size < 2 or time[0] < 0 or np.any(np.diff(time) <= 0):
        raise InputError(f"{path}: t must have at least two rows, increase from row to row and be at least 0 s")
    return columns


Reference = Annotated[Steps | Moves | Sine | Ramp | Trapezoid | TrajectoryFile, Field(discriminator="kind")]
