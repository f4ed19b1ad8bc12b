"""The inputs that acted on a plant during a log, with the sensors' filters, delays, scales and biases undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from ..core.log import Log
from ..physics.effects import EFFECTS
from ..plant.plant import Plant, Sensor
from ..simulation.engine import simulate
from ..simulation.sensors import filter_weights
from ..simulation.trajectory import Trajectory


def undo_sensor(plant: Plant, log: Log, channel: str) -> np.ndarray:
    """A channel (N,) of a log before its sensor filtered, delayed, scaled and biased it.

    Noise remains. Undoing a filter amplifies it about filter / sample time times. A zero-order-held input is inverted
    exactly; any other signal by y + filter dy/dt with central differences.
    """
    sensor, system = plant.sensors.get(channel), plant.structure.system
    if sensor is None:
        return log[channel]
    held = system.hold == "zero_order" and channel in system.drives.values()
    return invert_sensor(sensor, log[channel], log.sample_time, held=held)


def invert_sensor(sensor: Sensor, values: np.ndarray, sample_time: float, *, held: bool) -> np.ndarray:
    """True signal (N,) behind the sensor's output (N,), see `undo_sensor`; held: a zero-order-held input."""
    delay = sensor.delay / sample_time
    if delay > 0.0:
        index = np.arange(values.size)
        values = np.interp(index + delay, index, values)
    values = (values - sensor.bias) / sensor.scale
    if sensor.filter > 0.0:
        if held:
            a, b, _ = filter_weights(sensor.filter, sample_time, held=True)
            values = np.concatenate([values[:1], (values[1:] - a * values[:-1]) / b])
        else:
            values = values + sensor.filter * np.gradient(values, sample_time)
    return values


def acting_drive(plant: Plant, asked: np.ndarray, sample_time: float) -> tuple[Plant, np.ndarray]:
    """The plant without its drive's dead time, and the first input (N,) delayed by it instead.

    Between whole samples the delayed input is the mean over the sample of the held input, which is linear in the delay.
    """
    structure = plant.structure
    if structure.delay is None:
        return plant, asked
    delay = plant[structure.delay] / sample_time
    effects = tuple(name for name in structure.effects if not EFFECTS[name].delays)
    index = np.arange(asked.size)
    return plant.with_structure(replace(structure, effects=effects)), np.interp(index - delay, index, asked)


def lag_current(current: np.ndarray, samples: float) -> np.ndarray:
    """(N,) mean over each sample of a held current (N,) after a first-order lag with a time constant of `samples`."""
    a = np.exp(-1.0 / samples)
    now = lfilter([0.0, 1.0 - a], [1.0, -a], current - current[0]) + current[0]
    return np.asarray(current + (now - current) * samples * (1.0 - a))


def logged_inputs(plant: Plant, log: Log) -> tuple[np.ndarray, np.ndarray | None]:
    """The engine's two inputs (N,) from the log; None for a second input that no channel measures."""
    system = plant.structure.system
    values = [undo_sensor(plant, log, system.drives[name]) if name in system.drives else None for name in system.inputs]
    first = values[0]
    assert first is not None, "every system drives its first input by a channel"
    return first, values[1] if len(values) > 1 else None


def simulate_log(plant: Plant, log: Log, start: np.ndarray | None) -> Trajectory:
    """Free run with the log's inputs from the state `start` (n,) or from rest.

    A run that leaves the range of the equations ends early; `stopped` of the trajectory says why.
    """
    first, second = logged_inputs(plant, log)
    return simulate(
        plant, first, force=second, hold=plant.structure.system.hold, start=start, sample_time=log.sample_time,
        raise_on_failure=False,
    )  # fmt: skip
