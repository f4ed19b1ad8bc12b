"""What a scenario's TOML may contain."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from ..core.definition import Definition, Newton, Schema, Second
from ..core.errors import InputError, choices, shown
from ..core.protocol import MEASURED
from ..core.unit import parse
from ..plant.file import CHANNEL_UNITS, LIMIT_UNITS
from .baseline import BaselineTolerances
from .fault import Fault, Supervising
from .metrics import METRICS
from .reference import Reference
from .spread import Spread


class ForceStep(Definition):
    """[[disturbance]]: a force step on the rod, as many as there are tables.

    force: positive when it resists extension. start: when it begins. duration: left out, to the end of the run.
    """

    force: Newton
    start: Second
    duration: Second = float("inf")

    @model_validator(mode="after")
    def _fit(self) -> ForceStep:
        if self.start < 0 or self.duration <= 0:
            raise ValueError("start must be at least 0 s and duration more than 0 s")
        return self


class OtherSensor(Definition):
    """A sensor that differs from the plant's in this scenario; what is left out is as in the plant.

    noise: one standard deviation. step: of the converter. delay: how late it shows what it measures.
    """

    noise: str | None = None
    step: str | None = None
    delay: Second | None = None


class Measuring(Definition):
    """[sensors]: the plant's sensors, and what is different about them in this scenario.

    noise: whether they are noisy. seed: of that noise. lag: whole samples from a measurement to the current from it.
    [speed], [p1], [p2], [position], [force]: one sensor that differs from the plant's.
    """

    noise: bool = True
    seed: Annotated[int, Field(ge=0)] = 0
    lag: Annotated[int, Field(ge=0, le=50)] = 0
    speed: OtherSensor = OtherSensor()
    p1: OtherSensor = OtherSensor()
    p2: OtherSensor = OtherSensor()
    position: OtherSensor = OtherSensor()
    force: OtherSensor = OtherSensor()

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
    """Bounds of a metric on the nonlinear plant, in the metric's SI unit after reading.

    max: at most. min: at least.
    """

    max: float | None = None
    min: float | None = None

    @model_validator(mode="after")
    def _room(self) -> Limit:
        if self.max is not None and self.min is not None and self.min > self.max:
            raise ValueError(f"min = {self.min:g} is more than max = {self.max:g}; nothing would keep both")
        return self


class ScenarioFile(Definition):
    """A scenario's TOML.

    schema: version of this form. title: one line for lists and tables.
    why: in one sentence, what this scenario protects against.
    plant: name of a plant, or a path from this file's folder; it is checked on its nonlinear model.
    controller: name of a controller, or a path from this file's folder; it is designed on the plant's linear model.
    duration: of the run, 0.05 s to an hour.
    [load]: at the rod; forces are positive when they resist extension, what is left out is as in the plant.
    [settings]: what is believed of the plant here, by the symbols of its parameters.
    [reference]: where the rod is to be; positive extends it, 0 is mid-stroke.
    [[disturbance]]: force steps on the rod. [sensors]: what is different about the sensors.
    [[fault]]: what goes wrong. [supervision]: what is taken for possible; beyond it the loop stops.
    [limits]: of any metric on the nonlinear plant; one that is not kept makes the scenario fail.
    expect_trips: limits of the plant that must be passed here; any other trip makes the scenario fail.
    [baseline]: how far a run may be from the recorded one.
    [spread]: what `montecarlo` draws beyond what the plant's file gives with sd or bounds: one standard deviation
        ("10 %") or a range of two values.
    """

    schema_version: Schema = Field(alias="schema")
    title: str
    why: str
    plant: str
    controller: str
    duration: Second
    load: dict[Literal["stiffness", "preload", "hardening", "mass", "force"], str] = {}
    settings: dict[str, str] = {}
    reference: Reference
    disturbance: list[ForceStep] = []
    sensors: Measuring = Measuring()
    fault: list[Fault] = []
    supervision: Supervising | None = None
    limits: dict[str, Limit] = {}
    expect_trips: list[str] = []
    baseline: BaselineTolerances = BaselineTolerances()
    spread: dict[str, Spread] = {}

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
