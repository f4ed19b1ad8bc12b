"""What a plant's TOML may contain."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from ..core.definition import Definition, Hertz, Second
from ..core.errors import InputError
from ..core.parameter import SOURCES, Parameter, check_range
from ..core.unit import factor

#: What is watched in every run, with its SI unit.
LIMIT_UNITS = {
    "pump_speed": "rad/s",
    "motor_speed": "rad/s",
    "motor_torque": "N m",
    "motor_power": "W",
    "current_rms": "A",
    "pressure_max": "Pa",
    "pressure_min": "Pa",
    "stroke": "m",
}

#: The state without which a limit means nothing.
LIMIT_STATES = {
    **dict.fromkeys(("pump_speed", "motor_speed", "motor_torque", "motor_power", "current_rms"), "omega"),
    **dict.fromkeys(("pressure_max", "pressure_min"), "P_1"),
    "stroke": "x",
}

#: What the bench measures, with its SI unit.
CHANNEL_UNITS = {
    "current": "A",
    "speed": "rad/s",
    "p1": "Pa",
    "p2": "Pa",
    "position": "m",
    "force": "N",
    "velocity": "m/s",
    "acceleration": "m/s2",
    "drive_force": "N",
    "spring_p1": "Pa",
    "spring_p2": "Pa",
}

#: The words for the load in TOML and on the command line, and the letters in the equations.
LOAD_LETTERS = {"stiffness": "K_S", "preload": "F_pre", "hardening": "k_3", "mass": "m_L", "force": "F_0"}

Source = Literal["datasheet", "identified", "literature", "assumed", "derived"]
assert Source.__args__ == SOURCES  # type: ignore[attr-defined]


class Quantity(Definition):
    """A number as a plant states it: value, unit, where it comes from, how well it is known."""

    value: float
    unit: str
    source: Source
    sd: Annotated[float, Field(ge=0)] | None = None
    bounds: tuple[float, float] | None = None
    note: str = ""

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str) -> str:
        try:
            factor(unit, unit)
        except InputError as error:
            raise ValueError(str(error)) from None
        return unit

    def parameter(self, name: str, unit: str, where: str) -> Parameter:
        """As a Parameter in the SI `unit`. Raises InputError if the unit does not fit or bounds don't hold value."""
        try:
            scale = factor(self.unit, unit)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        lower, upper = self.bounds or (float("-inf"), float("inf"))
        check_range(f"{where}.value", self.value, self.unit, lower, upper)
        return Parameter(
            name=name,
            value=self.value * scale,
            unit=unit,
            source=self.source,
            sd=None if self.sd is None else self.sd * scale,
            lower=lower * scale,
            upper=upper * scale,
            note=self.note,
            written=f"{self.value:g} {self.unit}",
        )


class SensorFile(Definition):
    """White noise (one sd), converter step, first-order filter, delay, scale and bias of one channel; absent: none."""

    noise: Quantity | None = None
    step: Quantity | None = None
    filter: Quantity | None = None
    delay: Quantity | None = None
    scale: Quantity | None = None
    bias: Quantity | None = None


class EstimationFile(Definition):
    """How `identify` estimates a model: by its simulation or by its balances, and how those are filtered.

    beside: whether, with balances, the simulation is tried as well; not where it lacks what the machine does.
    """

    method: Literal["simulation", "balances"] = "simulation"
    balances: Literal["weak", "filtered"] = "weak"
    width: Second | None = None
    cutoff: Hertz = 100.0
    parallel: Hertz | None = None
    beside: bool = True


class ModelFile(Definition):
    """Structure and identified parameters of one model of the plant; `free` is what `identify` estimates."""

    shaft_friction: str | None = None
    rod_friction: str | None = None
    chambers: str | None = None
    effects: list[str] = []
    free: list[str] | None = None
    estimation: EstimationFile = EstimationFile()
    parameters: dict[str, Quantity]


class ColumnFile(Definition):
    """Where somebody else's logs keep a channel: SI value = scale * column + offset."""

    column: str
    scale: float = 1.0
    offset: float = 0.0


class SamplingFile(Definition):
    period: Quantity


class PlantFile(Definition):
    """A plant's TOML."""

    schema_version: Literal[1] = Field(alias="schema")
    title: str
    system: str
    note: str = ""
    parameters: dict[str, Quantity]
    linear: ModelFile | None = None
    nonlinear: ModelFile | None = None
    load: dict[Literal["stiffness", "preload", "hardening", "mass", "force"], Quantity] = {}
    limits: dict[str, Quantity] = {}
    sampling: SamplingFile
    sensors: dict[str, SensorFile] = {}
    log: dict[str, ColumnFile] = {}
