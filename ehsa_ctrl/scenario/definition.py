"""Scenario definitions: the schema of the TOML file and the loader."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from ..core.catalogue import controllers, plants, scenarios
from ..core.definition import Definition, Schema, Second, from_python, merged, validate
from ..core.errors import choices, shown
from ..core.files import read_toml
from ..core.result import Result
from ..plant.file import LIMIT_UNITS
from .baseline import BaselineTolerances
from .disturbances import CurrentLimit, Fault, ForceStep, SensorSettings, SupervisionSettings
from .metrics import METRICS
from .reference import Reference
from .uncertainty import Spread


class Limit(Definition):
    """Bounds on a metric of the nonlinear run, in SI units."""

    max: float | None = Field(default=None, description="largest value")
    min: float | None = Field(default=None, description="smallest value")

    @model_validator(mode="after")
    def _check_order(self) -> Limit:
        if self.max is not None and self.min is not None and self.min > self.max:
            raise ValueError(f"min = {self.min:g} is greater than max = {self.max:g}; no value satisfies both")
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
    load: dict[Literal["stiffness", "preload", "hardening", "mass", "force", "gap", "gap_retracting"], str] = Field(
        default={},
        description="load on the rod, positive if it resists extension; omitted keys keep the plant's values",
    )
    settings: dict[str, str] = Field(
        default={},
        description="plant parameters that this scenario changes, by symbol",
    )
    reference: Reference = Field(description="position reference; positive extends the rod, 0 is mid-stroke")
    disturbance: list[ForceStep] = Field(default=[], description="force steps on the rod")
    sensors: SensorSettings = Field(
        default=SensorSettings(), description="sensor settings that differ from the plant's"
    )
    fault: list[Fault] = Field(default=[], description="sensor and drive faults")
    supervision: SupervisionSettings | None = Field(
        default=None,
        description="plausibility limits; the loop stops when a reading exceeds one",
    )
    limits: dict[str, Limit] = Field(
        default={},
        description="limits on metrics of the nonlinear run; the scenario fails if one is violated",
    )
    expect_trips: list[str] = Field(
        default=[],
        description="plant limits that this scenario must exceed; exceeding any other limit fails it",
    )
    baseline: BaselineTolerances = Field(
        default=BaselineTolerances(),
        description="tolerances for the comparison with the recorded baseline",
    )
    spread: dict[str, Spread] = Field(
        default={},
        description="parameters that `montecarlo` draws in addition to those with sd or bounds in the plant's file: "
        'a standard deviation ("10 %") or a range of two values',
    )

    @model_validator(mode="after")
    def _check_event_times(self) -> ScenarioFile:
        starts = [start for start, _ in self.reference.holds()]
        starts += [change.end for change in self.reference.force_changes()]
        starts += [event.start for event in (*self.disturbance, *self.fault)]
        if self.reference.force is not None and self.reference.force.sine is not None:
            starts.append(self.reference.force.sine.start)
        late = [start for start in starts if start >= self.duration]
        if late:
            raise ValueError(
                f"duration = {self.duration:g} s, but an event of the scenario is at {late[0]:g} s; increase duration"
            )
        return self

    @model_validator(mode="after")
    def _check_limits_defined(self) -> ScenarioFile:
        for name in self.limits:
            if why := self.reason_undefined(name):
                raise ValueError(
                    f"[limits] {name}: is not defined here because {why}; limit another metric, such as MaxError"
                )
        return self

    @field_validator("why")
    @classmethod
    def _check_why(cls, why: str) -> str:
        if not why.strip():
            raise ValueError("is empty; state in one sentence what this scenario protects against")
        return why

    @field_validator("duration")
    @classmethod
    def _check_duration(cls, duration: float) -> float:
        if not 0.05 <= duration <= 3600:
            raise ValueError(f"{duration:g} s; expected 0.05 s to an hour")
        return duration

    @field_validator("expect_trips")
    @classmethod
    def _check_trips(cls, trips: list[str]) -> list[str]:
        for trip in trips:
            if trip not in LIMIT_UNITS:
                raise ValueError(f"{trip!r} is not a plant limit; {choices(trip, LIMIT_UNITS)}")
        return trips

    @field_validator("load", "settings", mode="before")
    @classmethod
    def _read_numbers(cls, table: Any, info: ValidationInfo) -> Any:
        """Numbers from Python as text without a unit, which settings read as SI."""
        if not isinstance(table, dict) or not from_python(info):
            return table
        numbers = {key: value for key, value in table.items() if type(value) in (int, float)}
        return table | {key: repr(value) for key, value in numbers.items()}

    @field_validator("spread", mode="before")
    @classmethod
    def _flatten(cls, spread: Any) -> Any:
        """Restore dotted keys: TOML parses load.stiffness = ... as a nested table."""
        if not isinstance(spread, dict):
            return spread
        flat: dict[str, Any] = {}
        for key, value in spread.items():
            flat |= {f"{key}.{word}": item for word, item in value.items()} if isinstance(value, dict) else {key: value}
        return flat

    @field_validator("limits", mode="before")
    @classmethod
    def _convert_limits(cls, limits: Any, info: ValidationInfo) -> Any:
        """Convert bounds such as "0.3 mm" to the SI unit of the metric."""
        if not isinstance(limits, dict):
            return limits
        read: dict[str, Any] = {}
        for name, bounds in limits.items():
            if name not in METRICS:
                raise ValueError(f"{name!r} is not a metric; {choices(name, METRICS)}")
            if not isinstance(bounds, dict) or not bounds:
                raise ValueError(f"{name} = {shown(bounds)}; expected {{ max = '...' }}, {{ min = '...' }} or both")
            for key, value in bounds.items():
                try:
                    read.setdefault(name, {})[key] = METRICS[name].read_bound(value, si=from_python(info))
                except ValueError as error:
                    raise ValueError(f"{name}.{key}{error}") from None
        return read

    def cycles(self) -> list[tuple[float, float]]:
        """Start and end of each full period of the reference [s]; empty for one that is not repeated."""
        period = getattr(self.reference, "period", None)
        if period is None:
            return []
        start = float(getattr(self.reference, "start", 0.0))
        count = int((self.duration - start) / period + 1e-9)
        return [(start + k * period, start + (k + 1) * period) for k in range(count)]

    def holds(self) -> list[tuple[float, float]]:
        """Intervals (start, end) [s] in which target and external force are both constant."""
        edges = sorted({edge for step in self.disturbance for edge in (step.start, step.start + step.duration)})
        spans = []
        for start, end in self.reference.holds():
            cuts = [start, *(edge for edge in edges if start < edge < min(end, self.duration)), end]
            spans += list(zip(cuts[:-1], cuts[1:], strict=True))
        return spans

    def reason_undefined(self, metric: str) -> str:
        """Reason why a metric is undefined for this scenario's reference; empty if it is defined."""
        match METRICS[metric].requires:
            case "force" if self.reference.force is None:
                return "the reference has no force target"
            case "step" if not self.reference.jumps():
                return f"the target of [reference] kind = {self.reference.kind!r} does not jump"
            case "cycle" if not self.cycles():
                return "the reference is not repeated: it has no period, or the run is shorter"
            case "hold" if not self.reference.holds():
                return f"the target of [reference] kind = {self.reference.kind!r} is never held"
        return ""

    @property
    def first_fault(self) -> float | None:
        """Start of the first fault [s]; None without faults."""
        return min((fault.start for fault in self.fault), default=None)

    @property
    def all_settings(self) -> dict[str, str]:
        """Plant parameters set by [load] and [settings], in the form that `load_plant` takes."""
        return {**{f"load.{word}": text for word, text in self.load.items()}, **self.settings}


@dataclass(frozen=True, repr=False)
class Scenario(Result):
    """A scenario definition with its name, its file, and the content that it was read from if that is a dictionary."""

    name: str
    definition: ScenarioFile
    path: Path | None = None
    content: Mapping[str, Any] | None = field(default=None, compare=False)

    @property
    def title(self) -> str:
        return self.definition.title

    def __str__(self) -> str:
        file = self.definition
        settings = ", ".join(f"{key} = {value}" for key, value in file.all_settings.items())
        return "\n".join([
            f"{self.name}: {file.title}",
            f"  {file.controller} on {file.plant}, {file.duration:g} s of {file.reference.kind}",
            *([f"  set for this scenario: {settings}"] if settings else []),
            *(f"  {name} {METRICS[name].format_bounds(bound.min, bound.max)}" for name, bound in file.limits.items()),
        ])  # fmt: skip


def require_drive_unit(scenario: Scenario, drive_unit: str) -> None:
    """Raise InputError for a fault of the drive that is stated in the unit of another plant's drive."""
    if not any(isinstance(fault, CurrentLimit) for fault in scenario.definition.fault):
        return
    content = scenario.content if scenario.path is None else read_toml(scenario.path)
    where = scenario.path or f"scenario {scenario.name}"
    for fault in (content or {}).get("fault", []):
        if fault["kind"] == "current_limit":
            context = {"drive_unit": drive_unit, "si": scenario.path is None}
            validate(dict(fault), CurrentLimit, f"{where}: [[fault]]", context)


def load_scenario(name: str | Path | Mapping[str, Any], *, label: str = "", **keys: Any) -> Scenario:
    """A scenario from a file or a dictionary.

    Parameters
    ----------
    name: catalogue name or path; or a dictionary with the keys of a scenario's TOML, of which schema, title and why may
        be left out, and plant and controller too where `run` gets them.
    label: name in tables and files; by default that of the file.
    keys: keys in place of those in the file or dictionary: duration=3.0, load={"stiffness": 80e3}. Of a table only the
        named keys change. Numbers are in SI units. A scenario with changed keys is not compared with a baseline.

    Raises InputError with file and key.
    """
    if isinstance(name, Mapping):
        label = label or "own"
        start = {"schema": 1, "title": label, "why": "a run from Python", "plant": "", "controller": ""}
        content, where, folder = merged({**start, **name}, keys), f"scenario {label}", Path()
    else:
        path = scenarios.find(name)
        content, where, folder = read_toml(path), str(path), path.parent
        if not keys:
            return Scenario(label or path.stem, validate(content, ScenarioFile, where, {"folder": folder}), path)
        for key, catalogue in (("plant", plants), ("controller", controllers)):
            if isinstance(content.get(key), str):
                content[key] = str(catalogue.find(content[key], beside=path))
        content, label = merged(content, keys), label or path.stem
    definition = validate(content, ScenarioFile, where, {"folder": folder, "si": True})
    return Scenario(label, definition, content=content)
