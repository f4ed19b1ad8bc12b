"""Channels in another unit than SI: their size against what the plant does with the same drive."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ..core.errors import SimulationError
from ..core.log import CHANNELS, Log
from ..core.unit import factor
from ..plant.plant import Plant
from .start import drive
from .window import sensor_sd

#: Units that rigs log in, by the SI unit.
USUAL = {
    "Pa": ("kPa", "bar", "MPa", "psi"),
    "rad/s": ("rpm", "deg/s", "rev/s"),
    "m": ("mm", "cm"),
    "m/s": ("mm/s", "cm/s"),
    "A": ("mA",),
    "N": ("kN",),
}
#: A size agrees with a unit within this factor; a size that is off by less than OFF is no question of units.
AGREES, OFF = 1.9, 4.0


def wrong_units(plant: Plant, log: Log) -> Iterator[tuple[str, str]]:
    """(channel, sentence) for each channel that another unit explains, with the scale to write.

    Outputs are held against a free run. If that run does nothing like the log in any of them, or can't be finished, the
    drive's own unit is tried. Speed and position answer for each other too: the pump turns the one into the other.
    """
    system = plant.structure.system
    sizes = _sizes(plant, log, {})
    plain = [size for size in sizes.values() if 1 / OFF < size < OFF]
    if not plain:
        for name in system.drives.values():
            for unit in USUAL.get(CHANNELS[name].unit, ()):
                scale = factor(unit, CHANNELS[name].unit)
                tried = _sizes(plant, log, {name: scale})
                if tried and sum(1 / OFF < size < OFF for size in tried.values()) > len(tried) / 2:
                    level = float(np.max(np.abs(log[name])))
                    yield (
                        name,
                        _sentence(
                            plant, name, unit, f"{name} goes to {level:.3g}, which {plant.name} can't follow", scale
                        ),
                    )
                    return
    ratio = gear(plant, log)
    for channel, size in sizes.items():
        si = CHANNELS[channel].unit
        if 1 / OFF < size < OFF:
            continue
        found = _nearest(plant, channel, size)
        if found is None:
            continue
        if si == "Pa" and not _level_agrees(plant, log, channel, found.times):
            continue
        if ratio is not None and si in ("rad/s", "m") and 1 / OFF < ratio < OFF:
            continue
        yield (
            channel,
            _sentence(
                plant,
                channel,
                found.unit,
                f"{channel} varies {_times(size)} what {plant.name} would with this drive",
                found.times,
            ),
        )


def _sizes(plant: Plant, log: Log, scales: Mapping[str, float]) -> dict[str, float]:
    """How many times each output varies as much as in a free run; drives scaled first. Without those of no motion."""
    channels = {name: scales.get(name, 1.0) * values for name, values in log.channels.items()}
    try:
        run = drive(plant, Log(log.time, channels), None)
    except SimulationError:
        return {}
    if run.stopped:
        return {}
    sizes = {}
    for channel, state in plant.structure.system.outputs.items():
        if channel not in log.channels:
            continue
        measured, simulated = log[channel], run[state]
        if state == "x":
            lag = min(max(int(round(0.1 / log.sample_time)), 1), len(log) // 4)
            measured, simulated = measured[lag:] - measured[:-lag], simulated[lag:] - simulated[:-lag]
        declared = plant.sensors[channel].sd if channel in plant.sensors else sensor_sd(plant, log, channel)
        if np.std(simulated) > 10.0 * declared and np.std(measured) > 0.0:
            sizes[channel] = float(np.std(measured) / np.std(simulated))
    return sizes


class _Unit(NamedTuple):
    """A unit that a column may be in, and by what the channel has to be multiplied then."""

    unit: str
    times: float


def _nearest(plant: Plant, channel: str, size: float) -> _Unit | None:
    """The unit that explains why a channel is `size` times too large, if one does.

    The mapping may lack a unit's factor, or have one where the column is in another unit, SI among them.
    """
    si = CHANNELS[channel].unit
    at = plant.log.get(channel)
    tried = []
    if at is not None and abs(at.scale) != 1.0:
        tried = [_Unit(unit, factor(unit, si) / abs(at.scale)) for unit in (si, *USUAL.get(si, ()))]
    tried += [_Unit(unit, factor(unit, si)) for unit in USUAL.get(si, ())]
    best = min(tried, key=lambda one: abs(math.log(size * one.times)), default=None)
    return best if best is not None and abs(math.log(size * best.times)) < math.log(AGREES) else None


def _level_agrees(plant: Plant, log: Log, channel: str, scale: float) -> bool:
    """The pressure's level in that unit is nearer to P_0 than as it stands."""
    level, rest = abs(float(np.mean(log[channel]))), plant.values.get("P_0", 0.0)
    if level == 0.0 or rest < 1e5:
        return True
    return abs(math.log(level * scale / rest)) < abs(math.log(level / rest))


def gear(plant: Plant, log: Log) -> float | None:
    """Rod travel over what the shaft has pumped, 1 if both units are right; None without both, or without a pump."""
    system, values = plant.structure.system, plant.values
    by_state = {state: channel for channel, state in system.outputs.items() if channel in log.channels}
    if not {"omega", "x"} <= by_state.keys() or not {"D", "A"} <= values.keys():
        return None
    lag = min(max(int(round(0.1 / log.sample_time)), 1), len(log) // 4)
    travelled = log[by_state["x"]][lag:] - log[by_state["x"]][:-lag]
    turned = np.convolve(log[by_state["omega"]], np.ones(lag), mode="valid") * log.sample_time
    size = float(np.std(turned)) * values["D"] / values["A"]
    return float(np.std(travelled)) / size if size > 0.0 else None


def _times(size: float) -> str:
    return f"{size:.3g} times" if size >= 1.0 else f"1/{1 / size:.3g} of"


def _sentence(plant: Plant, channel: str, unit: str, why: str, times: float) -> str:
    at = plant.log.get(channel)
    column, scale = (at.column, at.scale * times) if at else (channel, times)
    offset = f", offset = {at.offset:.7g}" if at is not None and at.offset else ""
    line = f'{channel} = {{ column = "{column}", scale = {scale:.7g}{offset} }}'
    return f"{why}: it is probably in {unit}; write {line} in the plant's [log] table"
