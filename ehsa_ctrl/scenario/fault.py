"""What goes wrong in a scenario, and what the controller's supervision takes for possible there."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..core.controller_interface import MEASURED
from ..core.definition import Ampere, Definition, In, Metre, RadianPerSecond, Second
from ..design.stages.supervision import Supervision
from ..plant.plant import Plant
from ..simulation.faults import DriveLimit, Faults, SensorFault

Pascal = Annotated[float, In("Pa")]
Channel = Literal["speed", "p1", "p2", "position", "force"]
assert Channel.__args__ == MEASURED  # type: ignore[attr-defined]


class _Fault(Definition):
    """A fault that is present for a while."""

    start: Second = Field(description="start time")
    duration: Second = Field(default=float("inf"), description="left out, to the end of the run")

    @model_validator(mode="after")
    def _fit(self) -> _Fault:
        if self.start < 0 or self.duration <= 0:
            raise ValueError("start must be at least 0 s and duration more than 0 s")
        return self


class StuckSensor(_Fault):
    """A sensor that holds its last value."""

    kind: Literal["stuck"] = Field(description="type of fault")
    channel: Channel = Field(description="channel of the sensor")


class LostSensor(_Fault):
    """A sensor whose samples are lost."""

    kind: Literal["lost"] = Field(description="type of fault")
    channel: Channel = Field(description="channel of the sensor")


class CurrentLimit(_Fault):
    """A drive that limits its current below the controller's limit."""

    kind: Literal["current_limit"] = Field(description="type of fault")
    current: Ampere = Field(description="largest current, in either direction")

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
    """[supervision]: plausibility limits; where a reading exceeds one, the loop stops with zero current."""

    lost: Second = Field(default=0.04, description="how long a reading may be missing")
    position: Metre = Field(default=float("inf"), description="largest rod position, in either direction")
    speed: RadianPerSecond = Field(default=float("inf"), description="largest shaft speed, in either direction")
    pressure_min: Pascal = Field(default=float("-inf"), description="lowest pressure")
    pressure_max: Pascal = Field(default=float("inf"), description="highest pressure")
    contradiction: Metre = Field(
        default=float("inf"),
        description="largest difference between measured position and that integrated from the shaft speed",
    )
    memory_time: Second = Field(default=0.25, description="time constant with which that difference is forgotten")

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
