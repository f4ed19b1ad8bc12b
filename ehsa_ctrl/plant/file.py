"""The format of a plant's TOML file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from ..core.definition import Array, Definition, Hertz, Schema, Second, Unlimited
from ..core.errors import InputError
from ..core.log import CHANNELS, REFERENCES
from ..core.parameter import SOURCES, Parameter, check_range
from ..core.unit import factor, unit_suffix

#: Limit that every run checks -> SI unit.
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

#: Limit -> state that a system must have for the limit to apply.
LIMIT_STATES = {
    **dict.fromkeys(("pump_speed", "motor_speed", "motor_torque", "motor_power", "current_rms"), "omega"),
    **dict.fromkeys(("pressure_max", "pressure_min"), "P_1"),
    "stroke": "x",
}

#: Channel that a sensor may measure -> SI unit.
CHANNEL_UNITS = {
    name: channel.unit for name, channel in CHANNELS.items() if name not in ("t", "current_measured", *REFERENCES)
}

#: Names of the load in TOML and on the command line -> symbols in the equations.
LOAD_SYMBOLS = {
    "stiffness": "K_S",
    "preload": "F_pre",
    "hardening": "k_3",
    "mass": "m_L",
    "force": "F_0",
    "gap": "x_C",
    "gap_retracting": "x_R",
}

_SYMBOLS = {f"load.{word}": symbol for word, symbol in LOAD_SYMBOLS.items()}
_KEYS = {symbol: key for key, symbol in _SYMBOLS.items()}


def symbol_of(key: str) -> str:
    """Symbol that a setting has in the equations: K_S for load.stiffness; other keys are symbols themselves."""
    return _SYMBOLS.get(key, key)


def key_of(symbol: str) -> str:
    """Key with which a user sets a symbol: load.stiffness for K_S; other symbols are keys themselves."""
    return _KEYS.get(symbol, symbol)


def label(symbol: str) -> str:
    """A symbol for messages, with its key if that differs: K_S (load.stiffness)."""
    return f"{symbol} ({_KEYS[symbol]})" if symbol in _KEYS else symbol


Source = Literal["datasheet", "identified", "literature", "assumed", "derived"]
assert Source.__args__ == SOURCES  # type: ignore[attr-defined]


class Quantity(Definition):
    """A number with its unit, source and uncertainty."""

    value: Unlimited = Field(description="number in `unit`")
    unit: str = Field(description="any unit that converts to the SI unit")
    source: Source = Field(description="origin of the number")
    sd: Annotated[float, Field(ge=0)] | None = Field(
        default=None,
        description="standard deviation in `unit`; montecarlo and analyse --draws draw from it",
    )
    spread: Annotated[float, Field(gt=0)] | None = Field(
        default=None,
        description="standard deviation between units of a fleet in `unit`; the prior deviation in a diagnosis",
    )
    bounds: Annotated[tuple[Unlimited, Unlimited], Array] | None = Field(
        default=None,
        description="[lower, upper] range of plausible values in `unit`; drawn uniformly where there is no sd",
    )
    note: str = Field(default="", description="reference or reason")

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str) -> str:
        try:
            factor(unit, unit)
        except InputError as error:
            raise ValueError(str(error)) from None
        return unit

    def parameter(self, name: str, unit: str, where: str) -> Parameter:
        """The Parameter in the SI `unit`. Raises InputError for a unit that does not fit and a value out of bounds."""
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
            spread=None if self.spread is None else self.spread * scale,
            lower=lower * scale,
            upper=upper * scale,
            note=self.note,
            written=f"{self.value:g}{unit_suffix(self.unit)}",
        )


class SensorFile(Definition):
    """[sensors.CHANNEL]: a sensor of the bench; keys that are left out are ideal."""

    noise: Quantity | None = Field(default=None, description="standard deviation of white noise")
    step: Quantity | None = Field(default=None, description="quantisation step")
    filter: Quantity | None = Field(default=None, description="time constant of a first-order low-pass filter")
    delay: Quantity | None = Field(default=None, description="delay")
    scale: Quantity | None = Field(default=None, description="gain: reading over true value, 1 is ideal")
    bias: Quantity | None = Field(default=None, description="offset of the reading")


class EstimationFile(Definition):
    """[estimation]: method of `identify`, and the filters of its balances."""

    method: Literal["simulation", "balances"] = Field(
        default="simulation",
        description="simulation error or residuals of the balances",
    )
    balances: Literal["weak", "filtered"] = Field(
        default="weak",
        description="derivatives by the weak form (integration by parts) or by filters",
    )
    width: Second | None = Field(default=None, description="window width of the weak form")
    cutoff: Hertz = Field(default=100.0, description="cutoff frequency of the filters")
    parallel: Hertz | None = Field(default=None, description="cutoff frequency of the parallel filters")
    beside: bool = Field(
        default=True,
        description="with balances, also fit by simulation; false where the model lacks known behaviour of the rig",
    )

    @model_validator(mode="after")
    def _positive(self) -> EstimationFile:
        for name in ("width", "cutoff", "parallel"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise ValueError(f"{name} = {value:g}; expected more than 0")
        return self


class ModelFile(Definition):
    """[linear] or [nonlinear]: structure and own parameters of one model of the plant."""

    shaft_friction: str | None = Field(
        default=None,
        description="friction law of the shaft (ehsa-ctrl list friction); none where the system has no such contact",
    )
    rod_friction: str | None = Field(
        default=None,
        description="friction law of the rod (ehsa-ctrl list friction); none where the system has no such contact",
    )
    chambers: str | None = Field(default=None, description="form of the chamber volumes")
    effects: list[str] = Field(
        default=[],
        description="effects added to the equations, by name (ehsa-ctrl list effects); a parameter that is left out "
        "has its typical value",
    )
    free: list[str] | None = Field(
        default=None,
        description='parameters that `identify` estimates; left out, every one whose source is "identified"',
    )
    estimation: EstimationFile = Field(default=EstimationFile(), description="estimation method of `identify`")
    parameters: dict[str, Quantity] = Field(description="parameters of this model alone")


class ColumnFile(Definition):
    """Column of a log with a channel: SI value = scale * column + offset."""

    column: str = Field(description="name of the column in the file")
    scale: float = Field(default=1.0, description="SI units per unit of the column; negative reverses the direction")
    offset: float = Field(default=0.0, description="in SI units, added after scaling")


class SamplingFile(Definition):
    """[sampling]: sample time of the bench."""

    period: Quantity = Field(description="sample time")


class WatchdogFile(Definition):
    """[watchdog]: safe output of `serve` when the controller is silent."""

    timeout: Quantity | None = Field(
        default=None,
        description="time without an answer after which the safe output acts, until the end of the run; 40 ms if left "
        "out",
    )
    safe_current: Quantity | None = Field(
        default=None, description="safe output, in the unit of the plant's drive; zero if left out"
    )


class PlantFile(Definition):
    """A plant's TOML."""

    schema_version: Schema = Field(alias="schema", description="format version")
    title: str = Field(description="one line for lists and tables")
    system: str = Field(description="set of equations")
    note: str = Field(default="", description="origin of the numbers")
    parameters: dict[str, Quantity] = Field(description="parameters that both models share; signs as in the equations")
    linear: ModelFile | None = Field(
        default=None, description="linear model; a plant has this, the nonlinear one or both"
    )
    nonlinear: ModelFile | None = Field(
        default=None, description="nonlinear model; a plant has this, the linear one or both"
    )
    load: dict[Literal["stiffness", "preload", "hardening", "mass", "force"], Quantity] = Field(
        default={},
        description="load at the rod, positive where it resists extension; what is left out is zero",
    )
    limits: dict[str, Quantity] = Field(default={}, description="limits that every run checks; exceeding one is a trip")
    sampling: SamplingFile = Field(description="sampling of the bench")
    watchdog: WatchdogFile = Field(
        default=WatchdogFile(), description="safe output of `serve` when the controller is silent"
    )
    sensors: dict[str, SensorFile] = Field(
        default={},
        description="sensors of the bench, by channel; one that is left out is ideal",
    )
    log: dict[str, ColumnFile] = Field(
        default={},
        description="columns of the rig's own logs; a channel that is left out has its own name and SI units",
    )
    log_controller: dict[str, Any] | None = Field(
        default=None,
        alias="log.controller",
        description="controller under which the logs are recorded: the keys of a controller's file, or "
        "`file = NAME`; `diagnose` then also simulates the closed loop",
    )

    @model_validator(mode="before")
    @classmethod
    def _take_controller(cls, content: Any) -> Any:
        """[log.controller] is a table beside the channels of [log]."""
        log = content.get("log") if isinstance(content, dict) else None
        if not isinstance(log, dict) or "controller" not in log:
            return content
        rest = {channel: column for channel, column in log.items() if channel != "controller"}
        return {**content, "log": rest, "log.controller": log["controller"]}
