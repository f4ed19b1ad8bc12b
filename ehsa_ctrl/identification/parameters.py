"""The parameters to estimate, of the plant and of its sensors, with their bounds and priors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.errors import InputError, choices
from ..core.log import Log
from ..core.unit import parse
from ..plant.file import label, symbol_of
from ..plant.plant import SENSOR_WORDS, Plant

#: Lower bound of a mass, volume or inertia, as a share of its nominal value; engineering judgement.
SMALLEST = 0.2
#: Physical ranges of a sensor's numbers [1, s, s]; a bias has none.
SENSOR_RANGES = {"scale": (0.0, math.inf), "delay": (0.0, 0.5), "filter": (0.0, 0.5)}


@dataclass(frozen=True)
class FreeParameter:
    """A parameter to estimate.

    name: a symbol of the plant (J_M), or bias.CHANNEL, scale.CHANNEL, delay.CHANNEL, filter.CHANNEL of a sensor.
    value: nominal value; unit: SI. lower, upper: bounds. prior_sd: standard deviation of a prior around `value`; None
    without a prior.
    """

    name: str
    value: float
    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    prior_sd: float | None = None

    @property
    def sensor(self) -> tuple[str, str] | None:
        """("bias", "p1") for a sensor's number, None for a symbol of the plant."""
        word, dot, channel = self.name.partition(".")
        return (word, channel) if dot else None

    def reference_size(self, value: float, logs: Sequence[Log]) -> float:
        """What a standard deviation is compared with: the value, or a size of the log where zero is a valid value."""
        if self.sensor is None:
            return abs(value)
        word, channel = self.sensor
        if word == "bias" and channel in logs[0].channels:
            return max(abs(value), 0.1 * float(np.std(logs[0][channel])))
        return max(abs(value), logs[0].sample_time) if word in ("delay", "filter") else abs(value)


def bounds_of(parameters: Sequence[FreeParameter]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (k,)."""
    return np.array([p.lower for p in parameters]), np.array([p.upper for p in parameters])


def free_parameters(
    plant: Plant,
    *,
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, float | None] | None = None,
) -> tuple[FreeParameter, ...]:
    """The plant's free parameters with additions and exceptions.

    Parameters
    ----------
    free: names to estimate besides `plant.free`, in either form (K_S or load.stiffness).
    fix: names of these to leave alone.
    bounds: name -> (lower, upper), SI units, instead of the bounds in the plant's file.
    priors: name -> standard deviation around the plant's value, SI units; None takes the plant's own sd.

    Raises
    ------
    InputError: an unknown name, bounds that exclude the value, a prior without sd, or nothing left to estimate.
    """
    bounds, priors = dict(bounds or {}), dict(priors or {})
    names = list(dict.fromkeys([*plant.free, *(symbol_of(name) for name in free)]))
    known = known_names(plant)
    for asked in (*names, *fix, *bounds, *priors):
        if symbol_of(asked) not in known:
            raise InputError(f"{asked}: can't be estimated for {plant.name}; {choices(asked, known)}")
    for name in fix:
        if symbol_of(name) not in names:
            raise InputError(f"{name}: can't be fixed, it is not free; {_free_list(names)}")
        names.remove(symbol_of(name))
    for name in (*bounds, *priors):
        if symbol_of(name) not in names:
            raise InputError(f"{name}: has a bound or a prior but is not free; {_free_list(names)}")
    if plant.structure.delay in names:
        raise InputError(
            f"{plant.structure.delay}: has no derivative to be estimated by; a dead time of the drive is equivalent to "
            f"delays of all sensors, so set it with --set and free delay.CHANNEL instead"
        )
    if not names:
        raise InputError(
            f"{plant.name} ({plant.model}) has no free parameter: none in its file is marked as identified or free; "
            "name some with --free"
        )
    limits = {symbol_of(name): pair for name, pair in bounds.items()}
    sds = {symbol_of(name): sd for name, sd in priors.items()}
    return tuple(_parameter(plant, name, limits.get(name), name in sds, sds.get(name)) for name in names)


def _free_list(names: Sequence[str]) -> str:
    return f"free are {', '.join(map(label, names)) or 'none'}"


def known_names(plant: Plant) -> tuple[str, ...]:
    """Everything that can be estimated of a plant: its symbols, then the numbers of its sensors."""
    channels = [c for c in plant.structure.system.outputs if c in plant.sensors]
    return (
        *plant.structure.equations.parameter_names,
        *(f"{word}.{channel}" for word in SENSOR_WORDS for channel in channels),
    )


def read_quantity(plant: Plant, name: str, text: str) -> float:
    """Read "1.1", "50 N/mm" or "2 ms" as a value of `name` in SI units. Raises InputError with the name."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return parse(text, _unit(plant, symbol_of(name)))
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def with_values(plant: Plant, names: Sequence[str], values: Sequence[float] | np.ndarray) -> Plant:
    """The plant with other values of symbols and sensors, by name. Raises InputError for an invalid value."""
    symbols = {name: float(v) for name, v in zip(names, values, strict=True) if "." not in name}
    sensors = dict(plant.sensors)
    for name, value in zip(names, values, strict=True):
        word, dot, channel = name.partition(".")
        if dot:
            changed: dict[str, Any] = {word: float(value)}
            sensors[channel] = replace(sensors[channel], **changed)
    return replace(plant.set(**symbols), sensors=sensors)


def _unit(plant: Plant, name: str) -> str:
    word, dot, channel = name.partition(".")
    if dot:
        return plant.sensors[channel].unit_of(word)
    return {kind.name: kind.unit for kind in plant.structure.equations.parameters}[name]


def _parameter(
    plant: Plant, name: str, bounds: tuple[float, float] | None, has_prior: bool, sd: float | None
) -> FreeParameter:
    unit = _unit(plant, name)
    word, dot, channel = name.partition(".")
    own_sd: float | None = None
    if dot:
        value = float(getattr(plant.sensors[channel], word))
        lower, upper = SENSOR_RANGES.get(word, (-math.inf, math.inf))
    else:
        parameter = plant.parameters[name]
        kind = next(kind for kind in plant.structure.equations.parameters if kind.name == name)
        value, own_sd = parameter.value, parameter.sd
        lower, upper = max(parameter.lower, kind.lower), min(parameter.upper, kind.upper)
        if kind.lower_open and lower <= kind.lower:
            # Not the excluded bound itself: as a mass goes to zero the equations become arbitrarily stiff.
            lower = kind.lower + SMALLEST * abs(value - kind.lower)
        lower, upper = min(lower, value), max(upper, value)
    if bounds is not None:
        lower, upper = bounds
        if not lower < upper or not lower <= value <= upper:
            raise InputError(
                f"{name}: bounds {lower:g} to {upper:g} {unit} must be in order and hold the start, {value:g}"
            )
    if not has_prior:
        return FreeParameter(name, value, unit, lower, upper)
    sd = own_sd if sd is None else sd
    if sd is None:
        raise InputError(f"{name}: its prior needs a standard deviation, the plant's file has none; give {name}=SD")
    if not (math.isfinite(sd) and sd > 0.0):
        raise InputError(f"{name}: the prior's standard deviation is {sd}; it must be greater than 0")
    return FreeParameter(name, value, unit, lower, upper, sd)
