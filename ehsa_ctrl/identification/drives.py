"""What drove a plant while a log was recorded: the logged drives with what their sensors did undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.log import Log
from ..physics.effects import EFFECTS
from ..plant.plant import Plant, Sensor
from ..simulation.sensors import filter_weights


def undo_sensor(plant: Plant, log: Log, channel: str) -> np.ndarray:
    """A channel (N,) as it was before its sensor filtered, delayed, scaled and biased it.

    Noise stays; undoing a filter makes more of it, some filter / sample time times as much. A held drive is what its
    filter needed to get from sample to sample, exactly; another signal is y + filter dy/dt by central differences.
    """
    sensor, system = plant.sensors.get(channel), plant.structure.system
    if sensor is None:
        return log[channel]
    held = system.hold == "zero_order" and channel in system.drives.values()
    return undone(sensor, log[channel], log.sample_time, held=held)


def undone(sensor: Sensor, values: np.ndarray, sample_time: float, *, held: bool) -> np.ndarray:
    """What a sensor saw when it showed these values (N,), see `undo_sensor`; held: a drive that holds its samples."""
    late = sensor.delay / sample_time
    if late > 0.0:
        index = np.arange(values.size)
        values = np.interp(index + late, index, values)
    values = (values - sensor.bias) / sensor.scale
    if sensor.filter > 0.0:
        if held:
            a, b, _ = filter_weights(sensor.filter, sample_time, held=True)
            values = np.concatenate([values[:1], (values[1:] - a * values[:-1]) / b])
        else:
            values = values + sensor.filter * np.gradient(values, sample_time)
    return values


def acting_drive(plant: Plant, asked: np.ndarray, sample_time: float) -> tuple[Plant, np.ndarray]:
    """The plant without its drive's dead time, and the first input (N,) moved by it instead.

    Of a held input that changes within a sample the sample's mean is taken: what is driven by it integrates it.
    """
    structure = plant.structure
    if structure.delay is None:
        return plant, asked
    late = plant[structure.delay] / sample_time
    effects = tuple(name for name in structure.effects if not EFFECTS[name].delays)
    index = np.arange(asked.size)
    # Between held samples the mean runs straight too.
    return plant.with_structure(replace(structure, effects=effects)), np.interp(index - late, index, asked)


def logged_drives(plant: Plant, log: Log) -> tuple[np.ndarray, np.ndarray | None]:
    """The engine's two inputs (N,) as the log has them; None for a second input that no channel drives."""
    system = plant.structure.system
    values = [undo_sensor(plant, log, system.drives[name]) if name in system.drives else None for name in system.inputs]
    first = values[0]
    assert first is not None, "the first input of a system is always driven"
    return first, values[1] if len(values) > 1 else None
