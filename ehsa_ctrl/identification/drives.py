"""What drove a plant while a log was recorded: the logged drives with their sensors' delay, bias and scale undone."""

from __future__ import annotations

import numpy as np

from ..core.log import Log
from ..plant.plant import Plant


def undo_sensor(plant: Plant, log: Log, channel: str) -> np.ndarray:
    """A channel (N,) as it was before its sensor delayed, scaled and biased it; noise stays."""
    values = log[channel]
    sensor = plant.sensors.get(channel)
    if sensor is None:
        return values
    late = sensor.delay / log.sample_time
    if late > 0.0:
        index = np.arange(values.size)
        values = np.interp(index + late, index, values)
    return (values - sensor.bias) / sensor.scale


def logged_drives(plant: Plant, log: Log) -> tuple[np.ndarray, np.ndarray | None]:
    """The engine's two inputs (N,) as the log has them; None for a second input that no channel drives."""
    system = plant.structure.system
    values = [undo_sensor(plant, log, system.drives[name]) if name in system.drives else None for name in system.inputs]
    first = values[0]
    assert first is not None, "the first input of a system is always driven"
    return first, values[1] if len(values) > 1 else None
