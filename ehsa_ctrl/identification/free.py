"""What is estimated: parameters of the plant and of its sensors, with bounds and priors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.errors import InputError, choices
from ..core.unit import parse
from ..plant.file import both, symbol_of
from ..plant.plant import SENSOR_WORDS, Plant

#: A mass, volume or inertia may come out as small as this share of what it was believed to be.
SMALLEST = 0.2


@dataclass(frozen=True)
class FreeParameter:
    """One number to be estimated.

    name: a symbol of the plant (J_M), or bias.CHANNEL, scale.CHANNEL, delay.CHANNEL, filter.CHANNEL of a sensor.
    value: where the plant believes it to be; unit: SI.
    lower, upper: it stays between them. prior_sd: how strongly it is held at `value`; None: not at all.
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


def free_parameters(
    plant: Plant,
    *,
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, float | None] | None = None,
) -> tuple[FreeParameter, ...]:
    """The plant's free parameters, more, or fewer.

    Parameters
    ----------
    free: names to estimate besides `plant.free`; load.stiffness and its like are understood.
    fix: names of these to leave alone.
    bounds: name -> (lower, upper), SI units, instead of the bounds in the plant's file.
    priors: name -> standard deviation around the plant's value, SI units; None takes the plant's own sd.

    Raises
    ------
    InputError: an unknown name, a bound on the wrong side, a prior without sd, or nothing left to estimate.
    """
    bounds, priors = dict(bounds or {}), dict(priors or {})
    names = list(dict.fromkeys([*plant.free, *(symbol_of(name) for name in free)]))
    known = known_names(plant)
    for asked in (*names, *fix, *bounds, *priors):
        if symbol_of(asked) not in known:
            raise InputError(f"{asked}: is nothing that can be estimated of {plant.name}; {choices(asked, known)}")
    for name in fix:
        if symbol_of(name) not in names:
            raise InputError(
                f"{name}: can't be fixed, it is not free; free are {', '.join(map(both, names)) or 'none'}"
            )
        names.remove(symbol_of(name))
    for name in (*bounds, *priors):
        if symbol_of(name) not in names:
            raise InputError(
                f"{name}: has a bound or a prior but is not free; free are {', '.join(map(both, names)) or 'none'}"
            )
    if plant.structure.delay in names:
        raise InputError(
            f"{plant.structure.delay}: has no derivative to be estimated by; a dead time of the drive is the same as "
            f"delays of all sensors, so set it with --set and free delay.CHANNEL instead"
        )
    if not names:
        raise InputError(
            f"nothing is left to estimate of {plant.name} ({plant.model}): its file calls nothing identified and names "
            "nothing free; say which with --free"
        )
    limits = {symbol_of(name): pair for name, pair in bounds.items()}
    held = {symbol_of(name): sd for name, sd in priors.items()}
    return tuple(_parameter(plant, name, limits.get(name), name in held, held.get(name)) for name in names)


def known_names(plant: Plant) -> tuple[str, ...]:
    """Everything that can be estimated of a plant: its symbols, then the words of its sensors."""
    channels = [c for c in plant.structure.system.outputs if c in plant.sensors]
    return (
        *plant.structure.equations.parameter_names,
        *(f"{word}.{channel}" for word in SENSOR_WORDS for channel in channels),
    )


def read_quantity(plant: Plant, name: str, text: str) -> float:
    """Read "1.1", "50 N/mm" or "2 ms" as a value of `name` in SI units. Raises InputError naming it."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return parse(text, _unit(plant, symbol_of(name)))
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def with_values(plant: Plant, names: Sequence[str], values: Sequence[float] | np.ndarray) -> Plant:
    """The plant with other values of symbols and sensors, by name. Raises InputError for an impossible one."""
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
    plant: Plant, name: str, bounds: tuple[float, float] | None, held: bool, sd: float | None
) -> FreeParameter:
    unit = _unit(plant, name)
    word, dot, channel = name.partition(".")
    own_sd: float | None = None
    if dot:
        value = float(getattr(plant.sensors[channel], word))
        ranges = {"scale": (0.0, math.inf), "delay": (0.0, 0.5), "filter": (0.0, 0.5)}
        lower, upper = ranges.get(word, (-math.inf, math.inf))
    else:
        parameter = plant.parameters[name]
        kind = next(kind for kind in plant.structure.equations.parameters if kind.name == name)
        value, own_sd = parameter.value, parameter.sd
        lower, upper = max(parameter.lower, kind.lower), min(parameter.upper, kind.upper)
        if kind.lower_open and lower <= kind.lower:
            # Not at the forbidden end itself: without mass the equations are stiff beyond all measure.
            lower = kind.lower + SMALLEST * abs(value - kind.lower)
        lower, upper = min(lower, value), max(upper, value)
    if bounds is not None:
        lower, upper = bounds
        if not lower < upper or not lower <= value <= upper:
            raise InputError(
                f"{name}: bounds {lower:g} to {upper:g} {unit} must be in order and hold the start, {value:g}"
            )
    if held and sd is None:
        sd = own_sd
        if sd is None:
            raise InputError(f"{name}: its prior needs a standard deviation, the plant's file has none; give {name}=SD")
    if held and not (sd is not None and math.isfinite(sd) and sd > 0.0):
        raise InputError(f"{name}: the prior's standard deviation is {sd}; it must be greater than 0")
    return FreeParameter(name, value, unit, lower, upper, sd if held else None)
