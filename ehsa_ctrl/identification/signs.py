"""Channels whose direction is the other one: measured and simulated run against each other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..core.errors import SimulationError
from ..core.log import Log
from ..plant.plant import Plant
from .start import drive

#: Correlation of rates from which a direction is sure.
SURE = 0.3


def swapped(plant: Plant, log: Log) -> Iterator[tuple[str, str]]:
    """(channel, sentence) for what runs against the replay: outputs one by one, or the drive if all of them do.

    Position is judged by its change over 20 ms: itself it drifts in a free run. Both pressures against it while the
    rest agrees are exchanged, not each turned round.
    """
    ways = directions(plant, log)
    if not ways or all(way > -SURE for way in ways.values()):
        return
    against = [channel for channel, way in ways.items() if way < -SURE]
    along = [channel for channel, way in ways.items() if way > SURE]
    drives = list(plant.structure.system.drives.values())
    if not along and len(ways) > 1:
        names = " or ".join(drives)
        yield (
            drives[0],
            _turn(plant, drives[0], f"all of {', '.join(against)} run against {names}: its sign is swapped"),
        )
        return
    outputs = plant.structure.system.outputs
    pressures = [channel for channel in against if outputs[channel] in ("P_1", "P_2")]
    if len(pressures) == 2:
        first, second = pressures
        one, two = _column(plant, first), _column(plant, second)
        yield (
            first,
            (
                f"{first} and {second} run against {' and '.join(along) or 'the drive'} (correlation with the replay "
                f"{ways[first]:.2f} and {ways[second]:.2f}): they are exchanged; write {first} = {{ column = "
                f'"{two}"{_scaled(plant, second)} }} and {second} = {{ column = "{one}"{_scaled(plant, first)} }} '
                "in the plant's [log] table"
            ),
        )
        against = [channel for channel in against if channel not in pressures]
    for channel in against:
        other = " and ".join(along) if along else f"the replay with {' and '.join(drives)}, or that is swapped"
        why = f"{channel} runs against {other} (correlation with the replay {ways[channel]:.2f}): its sign is swapped"
        yield channel, _turn(plant, channel, why)


def directions(plant: Plant, log: Log) -> dict[str, float]:
    """Correlation of each moving output with a free run from rest; empty if that run ends early or hardly moves."""
    try:
        run = drive(plant, log, None)
    except SimulationError:
        return {}
    ways: dict[str, float] = {}
    if len(run) < 50:
        return {}
    for channel, state in plant.structure.system.outputs.items():
        if channel not in log.channels:
            continue
        measured, simulated = log[channel][: len(run)], run[state]
        if state == "x":
            lag = max(int(round(0.02 / log.sample_time)), 1)
            measured, simulated = measured[lag:] - measured[:-lag], simulated[lag:] - simulated[:-lag]
        spread = float(np.std(measured) * np.std(simulated))
        if spread > 0.0:
            ways[channel] = float(np.mean((measured - measured.mean()) * (simulated - simulated.mean())) / spread)
    return ways


def _column(plant: Plant, channel: str) -> str:
    return plant.log[channel].column if channel in plant.log else channel


def _scaled(plant: Plant, channel: str) -> str:
    """The rest of a channel's mapping, which goes with its column."""
    mapped = plant.log.get(channel)
    scale = "" if mapped is None or mapped.scale == 1.0 else f", scale = {mapped.scale:g}"
    return scale + ("" if mapped is None or mapped.offset == 0.0 else f", offset = {mapped.offset:g}")


def _turn(plant: Plant, channel: str, why: str) -> str:
    at = plant.log.get(channel)
    scale, offset = (-at.scale, -at.offset) if at else (-1.0, 0.0)
    shift = f", offset = {offset:g}" if offset else ""
    return (
        f'{why}; write {channel} = {{ column = "{_column(plant, channel)}", scale = {scale:g}{shift} }} in the '
        "plant's [log] table"
    )
