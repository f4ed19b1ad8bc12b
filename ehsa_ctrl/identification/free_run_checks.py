"""Faults found by comparison with a free run of the plant: wrong units, sample time and signs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..core.errors import SimulationError
from ..core.log import CHANNELS, Log
from ..core.unit import factor
from ..plant.plant import Plant
from .initial_state import sensor_sd
from .logged_inputs import simulate_log
from .plant_log import column_of, log_table_entry

# The thresholds are engineering judgement: loose, so that a sound log is not rejected.

#: SI unit -> units in which logs are often recorded.
USUAL = {
    "Pa": ("kPa", "bar", "MPa", "psi"),
    "rad/s": ("rpm", "deg/s", "rev/s"),
    "m": ("mm", "cm"),
    "m/s": ("mm/s", "cm/s"),
    "A": ("mA",),
    "N": ("kN",),
}
#: A ratio of sizes agrees with a unit within the first factor; within the second, the unit is plausible as it is.
UNIT_FACTOR, PLAUSIBLE_FACTOR = 1.9, 4.0
#: A simulated channel moves if its standard deviation exceeds this multiple of the sensor's.
MIN_MOTION = 10.0
#: A position is compared by its change over this time [s], because it drifts in free run: for sizes, for agreement.
SIZE_TIME, AGREEMENT_TIME = 0.1, 0.02
#: Correlation from which a direction is certain, and the shortest run that shows it [samples].
DIRECTION, SHORTEST_RUN = 0.3, 50
#: Correlation from which a load cell moves opposite to the simulation.
OPPOSITE = 0.8
#: Agreement with a free run from which a sample time is plausible, and by how much another sample time has to be
#: better: by the agreement alone, and if the rod's travel confirms it.
PLAUSIBLE, BETTER, BETTER_BY_TRAVEL = 0.5, 0.25, 0.1
#: Units of time, in s, that are tried.
UNITS = {60.0: "minutes", 1e-3: "ms"}
#: A sample time is tried within this factor of the plant's.
LARGEST_RATIO = 50.0
#: Ratios of travel to pumped volume that physical effects can cause: a wrong displacement or area, or free air (2 % at
#: 8 bar store half of what the pump delivers).
BY_EFFECTS = (0.3, 3.5)


class _Pair(NamedTuple):
    """A measured output and the simulated one, both (N,)."""

    measured: np.ndarray
    simulated: np.ndarray


def _compare(plant: Plant, log: Log, change_time: float, *, shortest: int = 0, cell: bool = False) -> dict[str, _Pair]:
    """Each output with a free run from rest, positions by their change over a time [s]; with `cell`, the load cell too.

    Empty if the run diverges or ends before the log does; with `shortest`, before so many samples.
    """
    try:
        run = simulate_log(plant, log, None)
    except SimulationError:
        return {}
    if len(run) < shortest or (run.stopped and not shortest):
        return {}
    pairs = {}
    for channel, state in plant.structure.system.outputs.items():
        if channel in log.channels:
            measured, simulated = log[channel][: len(run)], run[state]
            if channel in plant.structure.system.positions:
                lag = _lag(log, change_time)
                measured, simulated = measured[lag:] - measured[:-lag], simulated[lag:] - simulated[:-lag]
            pairs[channel] = _Pair(measured, simulated)
    system = plant.structure.system
    if cell and system.cell is not None and system.cell_channel in log.channels:
        pairs[system.cell_channel] = _Pair(log[system.cell_channel][: len(run)], run.cell_force)
    return pairs


def _lag(log: Log, change_time: float) -> int:
    return min(max(int(round(change_time / log.sample_time)), 1), len(log) // 4)


# Units


def wrong_units(plant: Plant, log: Log) -> Iterator[tuple[str, str]]:
    """(channel, sentence with the scale to write) for each channel that another unit explains.

    Outputs are compared with a free run. If all of them differ from it, or the run diverges, units of the input are
    tried. Speed and position are also compared with each other, because the pump couples them.
    """
    system = plant.structure.system
    sizes = _sizes(plant, log)
    if not any(map(_plausible, sizes.values())):
        for name in system.drives.values():
            for unit in USUAL.get(CHANNELS[name].unit, ()):
                scale = factor(unit, CHANNELS[name].unit)
                scaled = _sizes(plant, Log(log.time, {**log.channels, name: scale * log[name]}))
                if scaled and sum(map(_plausible, scaled.values())) > len(scaled) / 2:
                    level = float(np.max(np.abs(log[name])))
                    why = f"{name} reaches {level:.3g}, which is implausible for {plant.name}"
                    yield name, _unit_sentence(plant, name, unit, why, scale)
                    return
    ratio = travel_ratio(plant, log)
    for channel, size in sizes.items():
        found = None if _plausible(size) else _nearest_unit(plant, channel, size)
        if found is None:
            continue
        unit, scale = found
        if CHANNELS[channel].unit == "Pa" and not _level_agrees(plant, log, channel, scale):
            continue
        if CHANNELS[channel].unit in ("rad/s", "m") and ratio is not None and _plausible(ratio):
            continue
        times = f"{size:.3g} times" if size >= 1.0 else f"1/{1 / size:.3g} of"
        why = f"{channel} varies {times} what {plant.name} does with this input in simulation"
        yield channel, _unit_sentence(plant, channel, unit, why, scale)


def _plausible(size: float) -> bool:
    return 1 / PLAUSIBLE_FACTOR < size < PLAUSIBLE_FACTOR


def _sizes(plant: Plant, log: Log) -> dict[str, float]:
    """Standard deviation of each output and the load cell over that of a free run; without those that do not move."""
    sizes = {}
    for channel, (measured, simulated) in _compare(plant, log, SIZE_TIME, cell=True).items():
        noise = plant.sensors[channel].sd if channel in plant.sensors else sensor_sd(plant, log, channel)
        if np.std(simulated) > MIN_MOTION * noise and np.std(measured) > 0.0:
            sizes[channel] = float(np.std(measured) / np.std(simulated))
    return sizes


def _nearest_unit(plant: Plant, channel: str, size: float) -> tuple[str, float] | None:
    """The unit that explains a channel `size` times too large, and the factor to multiply by; None for none.

    The mapping may lack a unit's factor, or have one while the column is in another unit, SI included.
    """
    si = CHANNELS[channel].unit
    at, usual = plant.log.get(channel), USUAL.get(si, ())
    tried = [(unit, factor(unit, si)) for unit in usual]
    if at is not None and abs(at.scale) != 1.0:
        tried = [(unit, factor(unit, si) / abs(at.scale)) for unit in (si, *usual)] + tried
    best = min(tried, key=lambda one: abs(math.log(size * one[1])), default=None)
    return best if best is not None and abs(math.log(size * best[1])) < math.log(UNIT_FACTOR) else None


def _level_agrees(plant: Plant, log: Log, channel: str, scale: float) -> bool:
    """Whether the mean pressure in that unit is nearer to P_0 than as it is."""
    level, rest = abs(float(np.mean(log[channel]))), plant.values.get("P_0", 0.0)
    if level == 0.0 or rest < 1e5:
        return True
    return abs(math.log(level * scale / rest)) < abs(math.log(level / rest))


def travel_ratio(plant: Plant, log: Log) -> float | None:
    """Rod travel over the travel that the shaft has pumped; None without both channels, or without a pump."""
    system, values = plant.structure.system, plant.values
    shafts = {contact.velocity for contact in system.contacts if contact.name == "shaft"}
    speeds = [channel for channel, state in system.outputs.items() if state in shafts and channel in log.channels]
    positions = [channel for channel in system.positions if channel in log.channels]
    if not speeds or not positions or not {"D", "A"} <= values.keys():
        return None
    lag = _lag(log, SIZE_TIME)
    travel = log[positions[0]][lag:] - log[positions[0]][:-lag]
    turned = np.convolve(log[speeds[0]], np.ones(lag), mode="valid") * log.sample_time
    size = float(np.std(turned)) * values["D"] / values["A"]
    return float(np.std(travel)) / size if size > 0.0 else None


def _unit_sentence(plant: Plant, channel: str, unit: str, why: str, scale: float) -> str:
    return f"{why}: it is probably in {unit}; write {log_table_entry(plant, channel, scale)} in the plant's [log] table"


# Sample time


def wrong_sample_time(plant: Plant, log: Log) -> str:
    """A sentence if the plant would move as in the log with another sample time than that of the time column, else "".

    Candidates are other units, the plant's own sample time, and the one at which the rod's travel equals the pumped
    volume. If both speed and position are logged, the travel has to confirm the candidate.
    """
    ratio = plant.sample_time / log.sample_time
    scales = [*UNITS, ratio]
    travel = travel_ratio(plant, log)
    if travel:
        by_travel = [] if BY_EFFECTS[0] < travel < BY_EFFECTS[1] else [travel]
        scales = [scale for scale in scales if 0.8 < scale / travel < 1.25] or by_travel
    scales = [
        scale for scale in scales if 1.0 / LARGEST_RATIO < scale / ratio < LARGEST_RATIO and not 0.9 < scale < 1.1
    ]
    as_logged = _agreement(plant, log, 1.0)
    if not scales or (not travel and as_logged > PLAUSIBLE):
        return ""
    agreements = {scale: _agreement(plant, log, scale) for scale in scales}
    best = max(agreements, key=lambda scale: agreements[scale])
    if agreements[best] < max(PLAUSIBLE, as_logged + (BETTER_BY_TRAVEL if travel else BETTER)):
        return ""
    probably = f"it is probably in {UNITS[best]}" if best in UNITS else "the logger probably had another sampling rate"
    given = f"give --sample-time {best * log.sample_time:.4g}"
    moves = f"but {plant.name} moves as in this log if they are {1e3 * best * log.sample_time:.3g} ms"
    if log.time_source:
        return f"by {log.time_source} the steps are {1e3 * log.sample_time:.3g} ms, {moves}: {probably}; {given}"
    return (
        f"column {column_of(plant, 't')!r} has steps of {1e3 * log.sample_time:.3g} ms, {moves}: {probably}; write "
        f"{log_table_entry(plant, 't', best, digits=4)} in the plant's [log] table, or {given}"
    )


def _agreement(plant: Plant, log: Log, scale: float) -> float:
    """Agreement of the outputs with a free run if samples are `scale` times as far apart: 1 exact, 0 none."""
    pairs = _compare(plant, Log(scale * log.time, log.channels), AGREEMENT_TIME).values()
    agreements = [
        1.0 - float(np.std(measured - simulated) / np.std(measured)) if np.std(measured) > 0.0 else 0.0
        for measured, simulated in pairs
    ]
    return float(np.median(agreements)) if agreements else 0.0


# Signs


def wrong_signs(plant: Plant, log: Log) -> Iterator[tuple[str, str]]:
    """(channel, sentence) for each output with the wrong sign, or for the input if all outputs are inverted.
    If both pressures are inverted and the other channels agree, the pressures are exchanged.
    """
    pairs = _compare(plant, log, AGREEMENT_TIME, shortest=SHORTEST_RUN, cell=True)
    cell = pairs.pop(plant.structure.system.cell_channel, None)
    ways = {channel: float(np.corrcoef(pair)[0, 1]) for channel, pair in pairs.items() if min(map(np.std, pair)) > 0.0}
    against = [channel for channel, way in ways.items() if way < -DIRECTION]
    along = [channel for channel, way in ways.items() if way > DIRECTION]
    if not against:
        yield from _wrong_cell_sign(plant, cell)
        return
    system = plant.structure.system
    drives = list(system.drives.values())
    if not along and len(ways) > 1:
        why = f"{', '.join(against)} all move opposite to {' or '.join(drives)}"
        yield drives[0], _inverted(plant, drives[0], why)
        return
    pressures = [channel for channel in against if system.outputs[channel] in system.pressures]
    if len(pressures) == 2:
        first, second = pressures
        yield (
            first,
            (
                f"{first} and {second} move opposite to {' and '.join(along) or 'the drive'} (correlation with the "
                f"simulation {ways[first]:.2f} and {ways[second]:.2f}): they are exchanged; write "
                f"{log_table_entry(plant, first, source=second)} and {log_table_entry(plant, second, source=first)} "
                "in the plant's [log] table"
            ),
        )
        against = [channel for channel in against if channel not in pressures]
    for channel in against:
        other = " and ".join(along) if along else f"the simulation (or {' and '.join(drives)} has the wrong sign)"
        why = f"{channel} moves opposite to {other} (correlation with the simulation {ways[channel]:.2f})"
        yield channel, _inverted(plant, channel, why)


def _wrong_cell_sign(plant: Plant, cell: _Pair | None) -> Iterator[tuple[str, str]]:
    """The same for the load cell, where all outputs agree with the simulation.

    It has to move as much as there: the force of a load that the plant lacks may oppose that of one which it has.
    """
    if cell is None or min(map(np.std, cell)) == 0.0 or not _plausible(float(np.std(cell[0]) / np.std(cell[1]))):
        return
    way = float(np.corrcoef(cell)[0, 1])
    if way < -OPPOSITE:
        channel = plant.structure.system.cell_channel
        why = f"{channel} moves opposite to the simulation (correlation {way:.2f}), while all other channels agree"
        yield channel, _inverted(plant, channel, why)


def _inverted(plant: Plant, channel: str, why: str) -> str:
    return f"{why}: its sign is wrong; write {log_table_entry(plant, channel, -1.0)} in the plant's [log] table"
