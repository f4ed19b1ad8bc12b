"""What a plant's TOML may contain."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from ..core.definition import Array, Definition, Hertz, Schema, Second, Unlimited
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

#: The words for the load in TOML and on the command line, and the symbols in the equations.
LOAD_SYMBOLS = {"stiffness": "K_S", "preload": "F_pre", "hardening": "k_3", "mass": "m_L", "force": "F_0"}

_SYMBOLS = {f"load.{word}": symbol for word, symbol in LOAD_SYMBOLS.items()}
_KEYS = {symbol: key for key, symbol in _SYMBOLS.items()}


def symbol_of(key: str) -> str:
    """The symbol in the equations of a setting: K_S of load.stiffness; every other key is its symbol."""
    return _SYMBOLS.get(key, key)


def key_of(symbol: str) -> str:
    """What a user sets it by: load.stiffness for K_S; every other symbol is its key."""
    return _KEYS.get(symbol, symbol)


def both(symbol: str) -> str:
    """A symbol as it is told to a user, who may have typed the key: K_S (load.stiffness)."""
    return f"{symbol} ({_KEYS[symbol]})" if symbol in _KEYS else symbol


Source = Literal["datasheet", "identified", "literature", "assumed", "derived"]
assert Source.__args__ == SOURCES  # type: ignore[attr-defined]


class Quantity(Definition):
    """A number as a plant states it: with its unit, where it comes from, and how well it is known.

    value: in the unit beside it. unit: any that converts.
    source: where it comes from. note: a reference or a reason.
    sd: one standard deviation, in the same unit; montecarlo and analyse --draws draw from it.
    bounds: [least, most] in which the value is believed, in the same unit; drawn evenly between where there is no sd.
    """

    value: Unlimited
    unit: str
    source: Source
    sd: Annotated[float, Field(ge=0)] | None = None
    bounds: Annotated[tuple[Unlimited, Unlimited], Array] | None = None
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
    """[sensors.CHANNEL]: one sensor of the bench; what is left out is not there.

    noise: white, one standard deviation. step: of the converter. filter: time constant, first order.
    delay: how late it shows what it measures. scale: reading over truth, 1 is right. bias: added to every reading.
    """

    noise: Quantity | None = None
    step: Quantity | None = None
    filter: Quantity | None = None
    delay: Quantity | None = None
    scale: Quantity | None = None
    bias: Quantity | None = None


class EstimationFile(Definition):
    """How `identify` estimates a model: by its simulation or by its balances, and how those are filtered.

    method: what is held against the log. balances: how their derivatives are had.
    width: of the windows of weak balances. cutoff, parallel: of the filters of filtered balances.
    beside: whether, with balances, the simulation is tried as well; not where it lacks what the machine does.
    """

    method: Literal["simulation", "balances"] = "simulation"
    balances: Literal["weak", "filtered"] = "weak"
    width: Second | None = None
    cutoff: Hertz = 100.0
    parallel: Hertz | None = None
    beside: bool = True

    @model_validator(mode="after")
    def _positive(self) -> EstimationFile:
        for name in ("width", "cutoff", "parallel"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise ValueError(f"{name} = {value:g}; expected more than 0")
        return self


class ModelFile(Definition):
    """Structure and identified parameters of one model of the plant.

    shaft_friction, rod_friction: friction law (ehsa-ctrl list friction); none where the system has no such contact.
    chambers: form of the chamber volumes.
    effects: what real rigs do beyond the equations, by name (ehsa-ctrl list effects); a parameter of an effect that
        is not given in [parameters] has its typical value.
    free: what `identify` estimates; left out, every parameter whose source is "identified".
    [estimation]: how `identify` works. [parameters]: those of this model alone.
    """

    shaft_friction: str | None = None
    rod_friction: str | None = None
    chambers: str | None = None
    effects: list[str] = []
    free: list[str] | None = None
    estimation: EstimationFile = EstimationFile()
    parameters: dict[str, Quantity]


class ColumnFile(Definition):
    """Where somebody else's logs keep a channel: SI value = scale * column + offset.

    column: its name in the file. scale: a negative one turns the direction. offset: in SI units.
    """

    column: str
    scale: float = 1.0
    offset: float = 0.0


class SamplingFile(Definition):
    """[sampling]: how often the bench measures.

    period: from sample to sample.
    """

    period: Quantity


class PlantFile(Definition):
    """A plant's TOML.

    schema: version of this form. title: one line for lists and tables. note: where the numbers come from.
    system: which equations.
    [parameters]: symbols that both models share; forces and pressures are positive as in the equations.
    [linear], [nonlinear]: the two models; a plant may have one of them.
    [load]: at the rod; forces are positive when they resist extension, what is left out is not there.
    [limits]: watched in every run; one that is passed is a trip. [sampling]: of the bench.
    [sensors]: of the bench, by channel; one that is left out is perfect.
    [log]: where this rig's own logs keep a channel; one that is left out has its own name and SI units.
    """

    schema_version: Schema = Field(alias="schema")
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
