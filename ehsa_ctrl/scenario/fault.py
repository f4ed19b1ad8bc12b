"""What goes wrong in a scenario, and what the controller's supervision takes for possible there."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..core.definition import Ampere, Definition, In, Metre, RadianPerSecond, Second
from ..core.protocol import MEASURED
from ..design.stages.supervision import Supervision
from ..plant.plant import Plant
from ..simulation.faults import DriveLimit, Faults, SensorFault

Pascal = Annotated[float, In("Pa")]
Channel = Literal["speed", "p1", "p2", "position", "force"]
assert Channel.__args__ == MEASURED  # type: ignore[attr-defined]


class _Fault(Definition):
    """What goes wrong for a while.

    kind: what it is. start: when it begins. duration: left out, to the end of the run.
    """

    start: Second
    duration: Second = float("inf")

    @model_validator(mode="after")
    def _fit(self) -> _Fault:
        if self.start < 0 or self.duration <= 0:
            raise ValueError("start must be at least 0 s and duration more than 0 s")
        return self


class StuckSensor(_Fault):
    """A sensor that goes on giving its last value.

    channel: of the sensor.
    """

    kind: Literal["stuck"]
    channel: Channel


class LostSensor(_Fault):
    """A sensor that gives nothing; its samples are lost.

    channel: of the sensor.
    """

    kind: Literal["lost"]
    channel: Channel


class CurrentLimit(_Fault):
    """A drive that gives no more than a current, whatever it is asked for.

    current: that much, to either side.
    """

    kind: Literal["current_limit"]
    current: Ampere

    @model_validator(mode="after")
    def _positive(self) -> CurrentLimit:
        if self.current < 0:
            raise ValueError("current must be at least 0 A")
        return self


Fault = Annotated[StuckSensor | LostSensor | CurrentLimit, Field(discriminator="kind")]


def faults_of(listed: list[StuckSensor | LostSensor | CurrentLimit]) -> Faults:
    """A scenario's faults as the simulation takes them."""
    return Faults(
        sensors=tuple(
            SensorFault(f.channel, f.kind, f.start, f.duration) for f in listed if not isinstance(f, CurrentLimit)
        ),
        drive=tuple(DriveLimit(f.current, f.start, f.duration) for f in listed if isinstance(f, CurrentLimit)),
    )


class Supervising(Definition):
    """A scenario's [supervision]: what is taken for possible; beyond it the loop stops and its current is zero.

    lost: how long a reading may be lost. position, speed: largest size, of the rod's position and the shaft's speed.
    pressure_min, pressure_max: range of both pressures.
    contradiction: largest difference of the rod's position and what the shaft's speed makes of it.
    memory_time: over which that difference is forgotten.
    """

    lost: Second = 0.04
    position: Metre = float("inf")
    speed: RadianPerSecond = float("inf")
    pressure_min: Pascal = float("-inf")
    pressure_max: Pascal = float("inf")
    contradiction: Metre = float("inf")
    memory_time: Second = 0.25

    @model_validator(mode="after")
    def _fit(self) -> Supervising:
        if min(self.position, self.speed, self.contradiction, self.memory_time) <= 0 or self.lost < 0:
            raise ValueError("position, speed, contradiction and memory_time must be greater than 0, lost at least 0 s")
        if self.pressure_min >= self.pressure_max:
            raise ValueError("pressure_min must be less than pressure_max")
        return self

    def of(self, plant: Plant) -> Supervision:
        """For a controller of this plant: rod travel per shaft angle is the plant's D / A."""
        return Supervision(**self.model_dump(), travel=plant["D"] / plant["A"])
