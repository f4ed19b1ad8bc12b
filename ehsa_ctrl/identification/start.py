"""Where a free run begins: at rest where the log does, else in the state that a second before it leads to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import SimulationError
from ..core.log import Log
from ..plant.plant import Plant
from ..simulation.engine import simulate
from ..simulation.trajectory import Trajectory
from .drives import logged_drives
from .window import REST, estimate_states, sensor_sd

#: Length of the piece before the log that leads to its first state, at most and at least [s].
RUN_IN, SHORTEST_RUN_IN = 1.0, 0.1
#: As many samples at rest have to agree before they may say that pressures at rest are other than the plant's.
REST_SAMPLES = 5
#: A sample agrees with a value within this many standard deviations of its sensor.
AGREES = 4.5


@dataclass(frozen=True)
class Start:
    """State (n,) at the first sample, and how it was found."""

    state: np.ndarray
    words: str

    def __str__(self) -> str:
        return self.words


def drive(plant: Plant, log: Log, start: np.ndarray | None) -> Trajectory:
    """Run the plant with the drives of a log, from `start` (n,) or from rest; what there is of a run that stopped."""
    system = plant.structure.system
    first, second = logged_drives(plant, log)
    return simulate(
        plant,
        first,
        force=second,
        hold=system.hold,
        start=start,
        sample_time=log.sample_time,
        raise_on_failure=False,
    )


def find_start(plant: Plant, log: Log, before: Log | None = None) -> Start:
    """The state at the log's first sample, without looking at what is scored, where that can be.

    A log that begins at rest starts at the plant's rest. Where it rests at other levels for REST_SAMPLES or more, it
    starts at rest at these. One pressure alone that is off while the rod is at x_0 is taken for its sensor's bias:
    oil that leaves one chamber goes to the other. A shorter rest counts if the rod is at x_0, or if the pressures are
    at P_0; else it may be a reversal.

    A log that begins in motion is a piece of a longer one (`before`), or not. If it is, the second before it is
    simulated and what that leads to is taken: the state a free run would have there. Only what integrates, the rod's
    position and the common level of the pressures, is moved to the mean of what was measured in that second; the rest
    forgets its beginning in some 0.1 s. If there is nothing before it, the first samples have to say it, smoothed.
    """
    at_rest = _at_rest(plant, log, resting_samples(plant, log))
    if at_rest is not None:
        return at_rest
    if before is not None and len(before) * log.sample_time >= SHORTEST_RUN_IN:
        found = _run_in(plant, before.segment(before.time[-1] - RUN_IN + 0.5 * before.sample_time))
        if found is not None:
            return found
    return _first_samples(plant, log)


def resting_samples(plant: Plant, log: Log) -> int:
    """How many samples from the first on show a plant at rest: speeds zero, positions and pressures constant."""
    system, resting = plant.structure.system, np.ones(len(log), dtype=bool)
    speeds = {contact.velocity for contact in system.contacts}
    shown = [channel for channel in system.outputs if channel in log.channels]
    for channel in shown:
        sd = sensor_sd(plant, log, channel)
        sensor = plant.sensors.get(channel)
        level = (sensor.bias if sensor else 0.0) if system.outputs[channel] in speeds else float(log[channel][0])
        # Where the level is itself one noisy sample, the difference has twice the variance.
        reach = AGREES * sd * (1.0 if system.outputs[channel] in speeds else np.sqrt(2.0))
        resting &= np.abs(log[channel] - level) <= reach
    moving = np.flatnonzero(~resting)
    count = int(moving[0]) if moving.size else len(log)
    if not any(system.outputs[channel] in speeds for channel in shown) and count < REST_SAMPLES:
        # No channel shows a speed: a single sample can't tell rest from motion.
        return 0
    return count


def _at_rest(plant: Plant, log: Log, samples: int) -> Start | None:
    """The state that the first samples at rest show; None if they are too few to be rest."""
    if samples == 0:
        return None
    states = plant.structure.equations.states
    state, levels = plant.rest.copy(), {}
    speeds = {contact.velocity for contact in plant.structure.system.contacts}
    for channel, name in plant.structure.system.outputs.items():
        if channel not in log.channels or name in speeds:
            continue
        column = plant.structure.equations.index(name)
        sensor, sd = plant.sensors.get(channel), sensor_sd(plant, log, channel)
        scale, bias = (sensor.scale, sensor.bias) if sensor else (1.0, 0.0)
        level = (float(np.mean(log[channel][:samples])) - bias) / scale
        if abs(level - state[column]) > AGREES * sd / scale / np.sqrt(samples) + 1e-12:
            levels[channel] = (column, level)
    pressures = [channel for channel, (column, _) in levels.items() if states[column].unit == "Pa"]
    if samples < REST_SAMPLES and pressures and len(levels) > len(pressures):
        return None
    # A rod that is held from outside lets one chamber carry its load, and no rest of its own is known.
    held = bool(plant.structure.system.prescribed)
    if not held and len(levels) == len(pressures) and (samples < REST_SAMPLES or len(pressures) == 1):
        levels = {}
    for column, level in levels.values():
        state[column] = level
    if not levels:
        return Start(state, "at rest, as the plant")
    count = "sample shows" if samples == 1 else f"{samples} samples show"
    return Start(state, f"at rest, with {', '.join(levels)} as the first {count}")


def _first_samples(plant: Plant, log: Log) -> Start:
    piece = replace(log.segment(log.time[0], log.time[min(14, len(log) - 1)]), before=None)
    return Start(_smoothed(plant, piece), "in motion, from its first samples")


def _smoothed(plant: Plant, log: Log) -> np.ndarray:
    """The state (n,) at the first sample as the sensors show it; speeds within their noise are zero."""
    estimate = estimate_states(plant, log)
    state = np.array(estimate.values[0])
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(state[column]) < REST * estimate.sd[0, column]:
            state[column] = 0.0
    return state


def _run_in(plant: Plant, before: Log) -> Start | None:
    """Simulate the piece before the log; None if that run ended early."""
    at_rest = _at_rest(plant, before, resting_samples(plant, before))
    begin = at_rest.state if at_rest is not None else _smoothed(plant, before)
    # One sample more than was recorded before: the last one is the log's first.
    longer = Log(
        np.append(before.time, before.time[-1] + before.sample_time),
        {name: np.append(values, values[-1]) for name, values in before.channels.items()},
    )
    try:
        run = drive(plant, longer, begin)
    except SimulationError:
        return None
    if run.stopped:
        return None
    state = run.states[-1].copy()
    missed = {}
    for channel, name in plant.structure.system.outputs.items():
        if channel in before.channels:
            sensor = plant.sensors.get(channel)
            scale, bias = (sensor.scale, sensor.bias) if sensor else (1.0, 0.0)
            missed[name] = (before[channel] - bias) / scale - run[name][:-1]
    last = max(len(before) // 10, 1)
    index = plant.structure.equations.index
    if "x" in missed:
        state[index("x")] += np.mean(missed["x"][-last:])
    pressures = [name for name in ("P_1", "P_2") if name in missed]
    if len(pressures) == 2:
        state[[index("P_1"), index("P_2")]] += np.mean([np.mean(missed[name]) for name in pressures])
    return Start(state, f"in motion, from the {len(before) * before.sample_time:.3g} s before it")
