"""What a scenario's TOML may contain."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from ..core.controller_interface import MEASURED
from ..core.definition import Definition, Newton, Schema, Second
from ..core.errors import InputError, choices, shown
from ..core.unit import parse
from ..plant.file import CHANNEL_UNITS, LIMIT_UNITS
from .baseline import BaselineTolerances
from .fault import Fault, Supervising
from .metrics import METRICS
from .reference import Reference
from .spread import Spread


class ForceStep(Definition):
    """[[disturbance]]: force steps on the rod, one for each table."""

    force: Newton = Field(description="positive when it resists extension")
    start: Second = Field(description="start time")
    duration: Second = Field(default=float("inf"), description="left out, to the end of the run")

    @model_validator(mode="after")
    def _fit(self) -> ForceStep:
        if self.start < 0 or self.duration <= 0:
            raise ValueError("start must be at least 0 s and duration more than 0 s")
        return self


class OtherSensor(Definition):
    """A sensor of this scenario; what is left out is as in the plant."""

    noise: str | None = Field(default=None, description="standard deviation of the noise")
    step: str | None = Field(default=None, description="quantisation step")
    delay: Second | None = Field(default=None, description="delay")


class Measuring(Definition):
    """[sensors]: noise, delay and quantisation, where they differ from the plant's."""

    noise: bool = Field(default=True, description="whether the sensors are noisy")
    seed: Annotated[int, Field(ge=0)] = Field(default=0, description="seed of the noise")
    lag: Annotated[int, Field(ge=0, le=50)] = Field(
        default=0, description="samples of delay between measurement and current"
    )
    speed: OtherSensor = Field(default=OtherSensor(), description="speed sensor, where it differs from the plant's")
    p1: OtherSensor = Field(default=OtherSensor(), description="pressure sensor 1, where it differs from the plant's")
    p2: OtherSensor = Field(default=OtherSensor(), description="pressure sensor 2, where it differs from the plant's")
    position: OtherSensor = Field(
        default=OtherSensor(), description="position sensor, where it differs from the plant's"
    )
    force: OtherSensor = Field(default=OtherSensor(), description="load cell, where it differs from the plant's")

    @model_validator(mode="after")
    def _fit(self) -> Measuring:
        for channel in MEASURED:
            for word, value in self.changes(channel).items():
                if not 0 <= value < float("inf"):
                    raise ValueError(f"{channel}.{word} must be at least 0")
        return self

    def changes(self, channel: str) -> dict[str, Any]:
        """What differs from the plant's sensor of a channel, in SI units."""
        other: OtherSensor = getattr(self, channel)
        found: dict[str, Any] = {}
        for word, text in (("noise", other.noise), ("step", other.step)):
            if text is not None:
                try:
                    found[word] = parse(text, CHANNEL_UNITS[channel])
                except InputError as error:
                    raise ValueError(f"{channel}.{word}: {error}") from None
        return found | ({} if other.delay is None else {"delay": other.delay})


class Limit(Definition):
    """Limits of a metric on the nonlinear plant, in SI units."""

    max: float | None = Field(default=None, description="largest value")
    min: float | None = Field(default=None, description="smallest value")

    @model_validator(mode="after")
    def _room(self) -> Limit:
        if self.max is not None and self.min is not None and self.min > self.max:
            raise ValueError(f"min = {self.min:g} is more than max = {self.max:g}; nothing would keep both")
        return self


class ScenarioFile(Definition):
    """A scenario's TOML."""

    schema_version: Schema = Field(alias="schema", description="format version")
    title: str = Field(description="one line for lists and tables")
    why: str = Field(description="one sentence: what this scenario protects against")
    plant: str = Field(description="name of a plant, or a path relative to this file; its nonlinear model is simulated")
    controller: str = Field(
        description="name of a controller, or a path relative to this file; designed on the plant's linear model",
    )
    duration: Second = Field(description="length of the run, 0.05 s to an hour")
    load: dict[Literal["stiffness", "preload", "hardening", "mass", "force"], str] = Field(
        default={},
        description="load at the rod, positive where it resists extension; what is left out is as in the plant",
    )
    settings: dict[str, str] = Field(
        default={},
        description="other values of the plant's parameters in this scenario, by symbol",
    )
    reference: Reference = Field(description="position reference; positive extends the rod, 0 is mid-stroke")
    disturbance: list[ForceStep] = Field(default=[], description="force steps on the rod")
    sensors: Measuring = Field(default=Measuring(), description="sensors, where they differ from the plant's")
    fault: list[Fault] = Field(default=[], description="sensor and drive faults")
    supervision: Supervising | None = Field(
        default=None,
        description="plausibility limits; the loop stops where a reading exceeds one",
    )
    limits: dict[str, Limit] = Field(
        default={},
        description="limits of any metric on the nonlinear plant; the scenario fails where one is exceeded",
    )
    expect_trips: list[str] = Field(
        default=[],
        description="limits of the plant that must trip in this scenario; any other trip makes it fail",
    )
    baseline: BaselineTolerances = Field(
        default=BaselineTolerances(),
        description="tolerances of a run around the recorded baseline",
    )
    spread: dict[str, Spread] = Field(
        default={},
        description="what `montecarlo` draws besides the parameters with sd or bounds in the plant's file: a "
        'standard deviation ("10 %") or a range of two values',
    )

    @model_validator(mode="after")
    def _within(self) -> ScenarioFile:
        begins = [step.start for step in (*self.disturbance, *self.fault)]
        late = [at for at in (*(start for start, _ in self.reference.holds()), *begins) if at >= self.duration]
        if late:
            raise ValueError(
                f"something is to happen at {late[0]:g} s, but duration is {self.duration:g} s; make it longer"
            )
        return self

    @model_validator(mode="after")
    def _defined(self) -> ScenarioFile:
        for name in self.limits:
            if why := self.undefined(name):
                raise ValueError(f"[limits] {name}: is not defined here, for {why}; limit another metric, as MaxError")
        return self

    @field_validator("why")
    @classmethod
    def _said(cls, why: str) -> str:
        if not why.strip():
            raise ValueError("say in one sentence what this scenario protects against")
        return why

    @field_validator("duration")
    @classmethod
    def _positive(cls, duration: float) -> float:
        if not 0.05 <= duration <= 3600:
            raise ValueError(f"{duration:g} s; expected 0.05 s to an hour")
        return duration

    @field_validator("expect_trips")
    @classmethod
    def _known_trips(cls, trips: list[str]) -> list[str]:
        for trip in trips:
            if trip not in LIMIT_UNITS:
                raise ValueError(f"{trip!r} is no limit of a plant; {choices(trip, LIMIT_UNITS)}")
        return trips

    @field_validator("spread", mode="before")
    @classmethod
    def _flat(cls, spread: Any) -> Any:
        """TOML reads load.stiffness = ... as a table within the table."""
        if not isinstance(spread, dict):
            return spread
        flat: dict[str, Any] = {}
        for key, value in spread.items():
            flat |= {f"{key}.{word}": item for word, item in value.items()} if isinstance(value, dict) else {key: value}
        return flat

    @field_validator("limits", mode="before")
    @classmethod
    def _in_units(cls, limits: Any) -> Any:
        """Read "0.3 mm" in the unit of its metric."""
        if not isinstance(limits, dict):
            return limits
        read: dict[str, Any] = {}
        for name, bounds in limits.items():
            if name not in METRICS:
                raise ValueError(f"{name!r} is no metric; {choices(name, METRICS)}")
            if not isinstance(bounds, dict) or not bounds:
                raise ValueError(f"{name} = {shown(bounds)}; expected {{ max = '...' }}, {{ min = '...' }} or both")
            read[name] = {key: _bound(name, key, value) for key, value in bounds.items()}
        return read

    def holds(self) -> list[tuple[float, float]]:
        """From when to when a place is to be held under the same force, s."""
        edges = sorted({edge for step in self.disturbance for edge in (step.start, step.start + step.duration)})
        spans = []
        for start, end in self.reference.holds():
            cuts = [start, *(edge for edge in edges if start < edge < min(end, self.duration)), end]
            spans += list(zip(cuts[:-1], cuts[1:], strict=True))
        return spans

    def undefined(self, metric: str) -> str:
        """Why a metric is not defined for this scenario's reference; empty where it is."""
        match METRICS[metric].of:
            case "step" if not self.reference.jumps():
                return f"the target of [reference] kind = {self.reference.kind!r} does not jump"
            case "hold" if not self.reference.holds():
                return f"the target of [reference] kind = {self.reference.kind!r} is never held"
        return ""

    @property
    def first_fault(self) -> float | None:
        """When the first thing goes wrong, s; None where nothing does."""
        return min((fault.start for fault in self.fault), default=None)

    @property
    def all_settings(self) -> dict[str, str]:
        """What is believed of the plant in this scenario, as for `load_plant`."""
        return {**{f"load.{word}": text for word, text in self.load.items()}, **self.settings}


def _bound(name: str, key: str, value: Any) -> Any:
    unit = METRICS[name].unit
    if isinstance(value, int | float) and not isinstance(value, bool) and unit != "1":
        raise ValueError(f"{name}.{key} = {value}: has no unit; write it as in '{value} {METRICS[name].shown}'")
    if isinstance(value, str):
        try:
            return parse(value, unit)
        except InputError as error:
            raise ValueError(f"{name}.{key}: {error}") from None
    return value
