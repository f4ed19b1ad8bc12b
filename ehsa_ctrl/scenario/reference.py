"""References of the rod position, one class for each form: the signal, its jumps and its holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from ..core.definition import Definition, Hertz, In, Metre, Second
from ..core.errors import InputError

#: Start and end of a hold [s].
Hold = tuple[float, float]
MetrePerSecond = Annotated[float, In("m/s")]
MetrePerSecond2 = Annotated[float, In("m/s2")]


class _Form(Definition):
    """A form of reference. Without overriding, its target never jumps and is never held."""

    kind: str = Field(description="type of reference")

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Position [m], speed and acceleration (N, 3); a jump of the position or speed has no derivative."""
        raise NotImplementedError

    def jumps(self) -> list[float]:
        """Times at which the target jumps [s]."""
        return []

    def holds(self) -> list[Hold]:
        """Intervals in which the target is constant [s]; the last one lasts to the end of the run."""
        return []


class _Targets(_Form):
    """A sequence of targets, one for each time."""

    times: list[Second] = Field(description="start time of each motion")
    positions: list[Metre] = Field(description="target position of each motion")

    @model_validator(mode="after")
    def _same_length(self) -> _Targets:
        if not self.times or len(self.times) != len(self.positions):
            raise ValueError(
                f"times has {len(self.times)} and positions {len(self.positions)} entries; give one position a time"
            )
        return self

    def holds(self) -> list[Hold]:
        return list(zip(self._ends(), [*self.times[1:], np.inf], strict=True))

    def _ends(self) -> list[float]:
        """Time at which each target is reached [s]."""
        return self.times


class Steps(_Targets):
    """Jumps; zero before the first."""

    kind: Literal["steps"] = Field(description="type of reference")
    times: list[Second] = Field(description="times of the steps")
    positions: list[Metre] = Field(description="target position after each step")

    @model_validator(mode="after")
    def _fit(self) -> Steps:
        if np.any(np.diff(self.times) <= 0) or self.times[0] < 0:
            raise ValueError("times must grow, from 0 s or later")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        values = np.zeros((time.size, 3))
        for at, position in zip(self.times, self.positions, strict=True):
            values[time >= at - 1e-9, 0] = position
        return values

    def jumps(self) -> list[float]:
        """Times at which the target jumps [s]; a repeated target is no jump."""
        return [at for at, way in zip(self.times, np.diff([0.0, *self.positions]), strict=True) if way != 0.0]


class Moves(_Targets):
    """Smooth moves, quintic, from rest to rest.

    s(t) = 10 t^3 - 15 t^4 + 6 t^5, so that speed and acceleration start and end at zero.
    """

    kind: Literal["moves"] = Field(description="type of reference")
    durations: list[Second] = Field(description="duration of each motion; it ends before the next begins")

    @model_validator(mode="after")
    def _fit(self) -> Moves:
        if len(self.times) != len(self.durations):
            raise ValueError(
                f"times, positions and durations have {len(self.times)}, {len(self.positions)} and "
                f"{len(self.durations)} entries; give as many of each"
            )
        ends = [0.0, *self._ends()]
        if min(self.durations) <= 0 or any(at < end for at, end in zip(self.times, ends, strict=False)):
            raise ValueError("every move must last more than 0 s and end before the next begins")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        values = np.zeros((time.size, 3))
        start = 0.0
        for at, position, takes in zip(self.times, self.positions, self.durations, strict=True):
            s = np.clip((time - at) / takes, 0.0, 1.0)
            way = position - start
            values[:, 0] += way * s**3 * (10 - 15 * s + 6 * s**2)
            values[:, 1] += way / takes * 30 * s**2 * (1 - s) ** 2
            values[:, 2] += way / takes**2 * 60 * s * (1 - s) * (1 - 2 * s)
            start = position
        return values

    def _ends(self) -> list[float]:
        return [at + takes for at, takes in zip(self.times, self.durations, strict=True)]


class Sine(_Form):
    """amplitude sin(2 pi frequency (t - start)), at zero before."""

    kind: Literal["sine"] = Field(description="type of reference")
    amplitude: Metre = Field(description="amplitude")
    frequency: Hertz = Field(description="frequency")
    start: Second = Field(default=0.0, description="start time")

    @model_validator(mode="after")
    def _fit(self) -> Sine:
        if self.frequency <= 0 or self.start < 0:
            raise ValueError("frequency must be greater than 0 Hz and start at least 0 s")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        w = 2 * np.pi * self.frequency
        t = time - self.start
        on = t >= 0
        columns = [np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)]
        return self.amplitude * np.column_stack(columns) * on[:, None]


class Ramp(_Form):
    """From zero to a position at constant speed, held there; the speed jumps at both ends."""

    kind: Literal["ramp"] = Field(description="type of reference")
    position: Metre = Field(description="final position")
    velocity: MetrePerSecond = Field(description="magnitude of the velocity")
    start: Second = Field(default=0.0, description="start time")

    @model_validator(mode="after")
    def _fit(self) -> Ramp:
        if self.velocity <= 0 or self.start < 0 or self.position == 0:
            raise ValueError("velocity must be greater than 0 m/s, start at least 0 s and position not 0 m")
        return self

    @property
    def end(self) -> float:
        """Time at which the ramp ends [s]."""
        return self.start + abs(self.position) / self.velocity

    def signal(self, time: np.ndarray) -> np.ndarray:
        way = np.sign(self.position)
        values = np.zeros((time.size, 3))
        values[:, 0] = way * np.clip(self.velocity * (time - self.start), 0.0, abs(self.position))
        values[:, 1] = way * self.velocity * ((time >= self.start - 1e-9) & (time < self.end - 1e-9))
        return values

    def holds(self) -> list[Hold]:
        return [(self.end, np.inf)]


class Trapezoid(_Targets):
    """Moves under a largest velocity and acceleration.

    Speed rises at constant acceleration, is held, and falls likewise; a short move has no held part.
    """

    kind: Literal["trapezoid"] = Field(description="type of reference")
    velocity: MetrePerSecond = Field(description="largest velocity")
    acceleration: MetrePerSecond2 = Field(description="largest acceleration")

    @model_validator(mode="after")
    def _fit(self) -> Trapezoid:
        if self.velocity <= 0 or self.acceleration <= 0:
            raise ValueError("velocity and acceleration must be greater than 0")
        ends = [0.0, *self._ends()]
        for at, end in zip(self.times, ends, strict=False):
            if at < end:
                raise ValueError(f"the move at {at:g} s begins before the one before it has ended, at {end:g} s")
        return self

    def _phases(self, way: float) -> tuple[float, float]:
        """Duration of the acceleration (and of the deceleration), and of constant speed [s]."""
        rise = min(self.velocity / self.acceleration, float(np.sqrt(abs(way) / self.acceleration)))
        held = abs(way) / self.velocity - rise if rise * self.acceleration >= self.velocity * (1 - 1e-12) else 0.0
        return rise, max(held, 0.0)

    def signal(self, time: np.ndarray) -> np.ndarray:
        values = np.zeros((time.size, 3))
        for at, position, begin in zip(self.times, self.positions, [0.0, *self.positions], strict=False):
            way = position - begin
            rise, held = self._phases(way)
            a, sign, t = self.acceleration, np.sign(way), np.maximum(time - at, 0.0)
            first, second = np.minimum(t, rise), np.clip(t - rise, 0.0, held)
            third = np.clip(t - rise - held, 0.0, rise)
            top = a * rise
            values[:, 0] += sign * (0.5 * a * first**2 + top * second + top * third - 0.5 * a * third**2)
            values[:, 1] += sign * a * (first - third)
            on = time >= at - 1e-12
            values[:, 2] += sign * a * ((on & (t < rise)).astype(float) - ((third > 0) & (third < rise)))
        return values

    def _ends(self) -> list[float]:
        ends = []
        for at, position, begin in zip(self.times, self.positions, [0.0, *self.positions], strict=False):
            rise, held = self._phases(position - begin)
            ends.append(at + 2 * rise + held)
        return ends


class TrajectoryFile(_Form):
    """A trajectory from a CSV: t [s], position [m] and, optionally, velocity [m/s] and acceleration [m/s2].

    All are linear between the rows; without a velocity column the velocity is the slope of the position. The last
    position is held.
    """

    kind: Literal["file"] = Field(description="type of reference")
    file: str = Field(description="path of the CSV, relative to the scenario's folder")
    start: Second = Field(default=0.0, description="time at which the file's t = 0 lies")
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
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TrajectoryFile) and self.model_dump() == other.model_dump()

    __hash__ = None  # type: ignore[assignment]

    def signal(self, time: np.ndarray) -> np.ndarray:
        table, t = self._table, time - self.start
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
        return [(self.start + float(self._table["t"][-1]), np.inf)]


def read_trajectory(path: Path) -> dict[str, np.ndarray]:
    """Columns of a trajectory's CSV: t and position, and velocity and acceleration where it has them.

    Raises InputError, naming file, column and row, for a file that is absent or is no such table.
    """
    from ..core.table import read_table

    table = read_table(path)
    for name in ("t", "position"):
        if name not in table.names:
            raise InputError(f"{path}: has no column {name!r}; expected t and position, in s and m")
    known = ("t", "position", "velocity", "acceleration")
    columns = {name: table.numbers(name) for name in known if name in table.names}
    time = columns["t"]
    if time.size < 2 or time[0] < 0 or np.any(np.diff(time) <= 0):
        raise InputError(f"{path}: t must grow from row to row, from 0 s or later, over at least two rows")
    return columns


Reference = Annotated[Steps | Moves | Sine | Ramp | Trapezoid | TrajectoryFile, Field(discriminator="kind")]
