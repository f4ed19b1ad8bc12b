"""Disturbances of a scenario: external forces, sensor settings and faults; supervision that stops the loop."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ..core.controller_interface import MEASURED
from ..core.definition import Definition, Drive, In, Metre, Newton, RadianPerSecond, Second
from ..core.errors import InputError
from ..core.unit import parse
from ..design.stages.supervision import Supervision
from ..plant.file import CHANNEL_UNITS
from ..plant.plant import Plant
from ..simulation.faults import DriveLimit, Faults, SensorFault

Pascal = Annotated[float, In("Pa")]
Channel = Literal["speed", "p1", "p2", "position", "force"]
assert Channel.__args__ == MEASURED  # type: ignore[attr-defined]


class _Event(Definition):
    """An event of limited duration."""

    start: Second = Field(description="start time")
    duration: Second = Field(default=float("inf"), description="default: to the end of the run")

    @model_validator(mode="after")
    def _check_times(self) -> _Event:
        if self.start < 0 or self.duration <= 0:
            raise ValueError("start must be at least 0 s and duration more than 0 s")
        return self


class ForceStep(_Event):
    """[[disturbance]]: a force step on the rod."""

    force: Newton = Field(description="force, positive if it resists extension")


class SensorOverride(Definition):
    """Settings of one sensor; omitted keys keep the plant's values."""

    noise: str | None = Field(default=None, description="standard deviation of the noise")
    step: str | None = Field(default=None, description="quantisation step")
    delay: Second | None = Field(default=None, description="delay")


def _override(sensor: str) -> Any:
    return Field(default=SensorOverride(), description=f"{sensor}: settings that differ from the plant's")


class SensorSettings(Definition):
    """[sensors]: noise, delay and quantisation that differ from the plant's."""

    noise: bool = Field(default=True, description="whether sensor noise is simulated")
    seed: Annotated[int, Field(ge=0)] = Field(default=0, description="seed of the sensor noise")
    lag: Annotated[int, Field(ge=0, le=50)] = Field(
        default=0, description="samples of delay between measurement and current"
    )
    speed: SensorOverride = _override("speed sensor")
    p1: SensorOverride = _override("pressure sensor 1")
    p2: SensorOverride = _override("pressure sensor 2")
    position: SensorOverride = _override("position sensor")
    force: SensorOverride = _override("load cell")

    @model_validator(mode="after")
    def _check_signs(self) -> SensorSettings:
        for channel in MEASURED:
            for word, value in self.changes(channel).items():
                if not 0 <= value < float("inf"):
                    raise ValueError(f"{channel}.{word} must be at least 0")
        return self

    def changes(self, channel: str) -> dict[str, Any]:
        """Settings of a channel's sensor that differ from the plant's, in SI units."""
        other: SensorOverride = getattr(self, channel)
        found: dict[str, Any] = {}
        for word, text in (("noise", other.noise), ("step", other.step)):
            if text is not None:
                try:
                    found[word] = parse(text, CHANNEL_UNITS[channel])
                except InputError as error:
                    raise ValueError(f"{channel}.{word}: {error}") from None
        return found | ({} if other.delay is None else {"delay": other.delay})


class StuckSensor(_Event):
    """A sensor that freezes at its last value."""

    kind: Literal["stuck"] = Field(description="type of fault")
    channel: Channel = Field(description="channel of the sensor")


class LostSensor(_Event):
    """A sensor whose samples are lost."""

    kind: Literal["lost"] = Field(description="type of fault")
    channel: Channel = Field(description="channel of the sensor")


class CurrentLimit(_Event):
    """A drive fault that limits the current below the controller's own limit."""

    kind: Literal["current_limit"] = Field(description="type of fault")
    current: Drive = Field(description="largest current, or other drive, in either direction")

    @model_validator(mode="after")
    def _check_current(self) -> CurrentLimit:
        if self.current < 0:
            raise ValueError("current must be at least 0")
        return self


Fault = Annotated[StuckSensor | LostSensor | CurrentLimit, Field(discriminator="kind")]


def faults_of(faults: list[StuckSensor | LostSensor | CurrentLimit]) -> Faults:
    """Convert a scenario's faults to those of the simulation."""
    return Faults(
        sensors=tuple(
            SensorFault(f.channel, f.kind, f.start, f.duration) for f in faults if not isinstance(f, CurrentLimit)
        ),
        drive=tuple(DriveLimit(f.current, f.start, f.duration) for f in faults if isinstance(f, CurrentLimit)),
    )


class SupervisionSettings(Definition):
    """[supervision]: plausibility limits; the loop stops with zero current when a reading exceeds one."""

    # Defaults as in `design.stages.supervision.Supervision`.
    lost: Second = Field(default=0.04, description="longest time for which a reading may be missing")
    position: Metre = Field(default=float("inf"), description="largest rod position, in either direction")
    speed: RadianPerSecond = Field(default=float("inf"), description="largest shaft speed, in either direction")
    pressure_min: Pascal = Field(default=float("-inf"), description="lowest pressure")
    pressure_max: Pascal = Field(default=float("inf"), description="highest pressure")
    contradiction: Metre = Field(
        default=float("inf"),
        description="largest difference between the measured position and the position integrated from the shaft speed",
    )
    memory_time: Second = Field(default=0.25, description="time constant with which that difference decays")

    @model_validator(mode="after")
    def _check_values(self) -> SupervisionSettings:
        if min(self.position, self.speed, self.contradiction, self.memory_time) <= 0 or self.lost < 0:
            raise ValueError("position, speed, contradiction and memory_time must be greater than 0, lost at least 0 s")
        if self.pressure_min >= self.pressure_max:
            raise ValueError("pressure_min must be less than pressure_max")
        return self

    def for_plant(self, plant: Plant) -> Supervision:
        """Supervision for a controller of this plant; the rod travels D / A per radian of the shaft."""
        return Supervision(**self.model_dump(), travel=plant["D"] / plant["A"])
