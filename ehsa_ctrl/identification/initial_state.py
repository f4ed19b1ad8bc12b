"""States from measured signals: smoothed over a log, and at the first sample of a free run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from ..core.errors import SimulationError
from ..core.log import Log
from ..plant.plant import Plant
from .logged_inputs import simulate_log

#: Samples of the parabola that gives a level, and of the one that gives the rod's speed as a slope: pressures change
#: within some ms, the rod's speed hardly faster.
LEVEL_SAMPLES, SLOPE_SAMPLES = 7, 11
#: A speed within this many standard deviations of its estimate is zero.
ZERO_SPEED = 4.0
#: Longest and shortest piece before a log that is simulated to find its first state [s].
RUN_IN, SHORTEST_RUN_IN = 1.0, 0.1
#: Samples at rest that have to agree before pressures at rest may differ from the plant's.
REST_SAMPLES = 5
#: A sample agrees with a level within this many standard deviations of its sensor.
REST_DEVIATIONS = 4.5
#: Samples from which a log that begins in motion takes its first state.
FIRST_SAMPLES = 15


def sensor_sd(plant: Plant, log: Log, channel: str) -> float:
    """Noise of a channel: the value in the plant's file, or else an estimate from the log.

    The estimate is the robust standard deviation of second differences over sqrt(6): a smooth signal hardly has any.
    """
    declared = plant.sensors[channel].sd if channel in plant.sensors else 0.0
    if declared > 0.0:
        return declared
    found = float(np.median(np.abs(np.diff(log[channel], 2)))) / 0.6745 / np.sqrt(6.0)
    return found if found > 0.0 else float(np.std(log[channel])) * 1e-3 or 1.0


@dataclass(frozen=True)
class StateEstimate:
    """Smoothed states over a log: values (N, n) and their standard deviations sd (N, n)."""

    values: np.ndarray
    sd: np.ndarray


def estimate_states(plant: Plant, log: Log) -> StateEstimate:
    """States from the measured channels without a model: local parabolas, the rod's speed as a slope.

    A state that no channel shows takes its rest value, and its whole scale as standard deviation.
    """
    states, slopes = plant.structure.equations.states, plant.structure.system.slopes
    channels = {state: channel for channel, state in plant.structure.system.outputs.items() if channel in log.channels}
    values = np.tile(plant.rest, (len(log), 1))
    sd = np.tile([state.scale for state in states], (len(log), 1))
    for column, state in enumerate(states):
        if state.name in channels:
            values[:, column], sd[:, column] = _smooth(plant, log, channels[state.name], LEVEL_SAMPLES, 0)
        elif (position := slopes.get(state.name)) in channels and len(log) >= 3:
            values[:, column], sd[:, column] = _smooth(plant, log, channels[position], SLOPE_SAMPLES, 1)
    return StateEstimate(values, sd)


def _smooth(plant: Plant, log: Log, channel: str, width: int, derivative: int) -> tuple[np.ndarray, np.ndarray]:
    """Level or slope of a channel (N,) by parabolas over `width` samples, and its standard deviation (N,)."""
    sensor, dt = plant.sensors[channel], log.sample_time
    measured = (log[channel] - sensor.bias) / sensor.scale
    noise = sensor_sd(plant, log, channel) / sensor.scale
    width = min(width, len(log) - 1 + len(log) % 2)
    if width < 3:
        return measured, np.full(len(log), noise)
    value = savgol_filter(measured, width, 2, deriv=derivative, delta=dt)
    half = width // 2
    # At the ends of the log the first or last parabola is evaluated off its centre.
    gain = [
        float(np.linalg.norm(savgol_coeffs(width, 2, deriv=derivative, delta=dt, pos=position)))
        for position in range(width)
    ]
    sd = np.full(len(log), noise * gain[half])
    sd[:half], sd[len(log) - half :] = noise * np.array(gain[:half]), noise * np.array(gain[half + 1 :])
    return value, sd


@dataclass(frozen=True)
class InitialState:
    """State (n,) at the first sample, and in words how it was found."""

    state: np.ndarray
    words: str

    def __str__(self) -> str:
        return self.words


def find_initial_state(plant: Plant, log: Log, before: Log | None = None) -> InitialState:
    """The state at the log's first sample, without the samples that are scored where possible.

    At rest: the plant's rest. If the log rests at other levels for REST_SAMPLES or more, rest at these levels. One
    pressure alone that is off while the rod is at x_0 is taken for a sensor bias, because oil that leaves one chamber
    enters the other. A shorter rest counts if the rod is at x_0 or the pressures are at P_0; otherwise it may be a
    reversal.

    In motion, with `before` (what was recorded up to the first sample): the end of a simulation of the last second.
    Only the states that integrate, the rod's position and the common level of the pressures, are then shifted to the
    mean measured there; the others forget their initial value within about 0.1 s. Without `before`: from the first
    samples, smoothed.
    """
    at_rest = _rest_state(plant, log, resting_samples(plant, log))
    if at_rest is not None:
        return at_rest
    if before is not None and len(before) * log.sample_time >= SHORTEST_RUN_IN:
        found = _run_in(plant, before.segment(before.time[-1] - RUN_IN + 0.5 * before.sample_time))
        if found is not None:
            return found
    piece = replace(log.segment(log.time[0], log.time[min(FIRST_SAMPLES, len(log)) - 1]), before=None)
    return InitialState(_smoothed_state(plant, piece), "in motion, from its first samples")


def resting_samples(plant: Plant, log: Log) -> int:
    """Number of samples from the first on that show a plant at rest: speeds zero, positions and pressures constant."""
    system, resting = plant.structure.system, np.ones(len(log), dtype=bool)
    speeds = {contact.velocity for contact in system.contacts}
    channels = [channel for channel in system.outputs if channel in log.channels]
    for channel in channels:
        limit = REST_DEVIATIONS * sensor_sd(plant, log, channel)
        if system.outputs[channel] in speeds:
            sensor = plant.sensors.get(channel)
            resting &= np.abs(log[channel] - (sensor.bias if sensor else 0.0)) <= limit
        else:
            # The level is one noisy sample itself, so that the difference has twice the variance.
            resting &= np.abs(log[channel] - log[channel][0]) <= limit * np.sqrt(2.0)
    moving = np.flatnonzero(~resting)
    count = int(moving[0]) if moving.size else len(log)
    if not any(system.outputs[channel] in speeds for channel in channels) and count < REST_SAMPLES:
        # Without a measured speed a single sample can't tell rest from motion.
        return 0
    return count


def _rest_state(plant: Plant, log: Log, samples: int) -> InitialState | None:
    """The state that the first samples at rest show; None if they are too few."""
    if samples == 0:
        return None
    states, state = plant.structure.equations.states, plant.rest.copy()
    speeds = {contact.velocity for contact in plant.structure.system.contacts}
    levels = {}
    for channel, name in plant.structure.system.outputs.items():
        if channel not in log.channels or name in speeds:
            continue
        column = plant.structure.equations.index(name)
        scale, bias = _scale_and_bias(plant, channel)
        level = (float(np.mean(log[channel][:samples])) - bias) / scale
        deviation = sensor_sd(plant, log, channel) / scale / np.sqrt(samples)
        if abs(level - state[column]) > REST_DEVIATIONS * deviation + 1e-12:
            levels[channel] = (column, level)
    pressures = [channel for channel, (column, _) in levels.items() if states[column].unit == "Pa"]
    if samples < REST_SAMPLES and pressures and len(levels) > len(pressures):
        return None
    # Where rod motion is prescribed one chamber alone may carry the load, so that a single pressure may be off.
    prescribed = bool(plant.structure.system.prescribed)
    if not prescribed and len(levels) == len(pressures) and (samples < REST_SAMPLES or len(pressures) == 1):
        levels = {}
    for column, level in levels.values():
        state[column] = level
    if not levels:
        return InitialState(state, "at rest, as the plant")
    count = "sample shows" if samples == 1 else f"{samples} samples show"
    return InitialState(state, f"at rest, with {', '.join(levels)} as the first {count}")


def _smoothed_state(plant: Plant, log: Log) -> np.ndarray:
    """The smoothed state (n,) at the first sample; speeds within their noise are zero."""
    estimate = estimate_states(plant, log)
    state = np.array(estimate.values[0])
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(state[column]) < ZERO_SPEED * estimate.sd[0, column]:
            state[column] = 0.0
    return state


def _run_in(plant: Plant, before: Log) -> InitialState | None:
    """The state at the end of a simulation of the piece before the log; None if that run ended early."""
    at_rest = _rest_state(plant, before, resting_samples(plant, before))
    begin = at_rest.state if at_rest is not None else _smoothed_state(plant, before)
    # One sample more than the piece has: the last one is the log's first.
    longer = Log(
        np.append(before.time, before.time[-1] + before.sample_time),
        {name: np.append(values, values[-1]) for name, values in before.channels.items()},
    )
    try:
        run = simulate_log(plant, longer, begin)
    except SimulationError:
        return None
    if run.stopped:
        return None
    state, index = run.states[-1].copy(), plant.structure.equations.index
    system, error = plant.structure.system, {}
    for channel, name in system.outputs.items():
        if channel in before.channels:
            scale, bias = _scale_and_bias(plant, channel)
            error[name] = (before[channel] - bias) / scale - run[name][:-1]
    for position in system.positions.values():
        if position in error:
            state[index(position)] += np.mean(error[position][-max(len(before) // 10, 1) :])
    if system.pressures and all(pressure in error for pressure in system.pressures):
        level = np.mean([np.mean(error[pressure]) for pressure in system.pressures])
        state[[index(pressure) for pressure in system.pressures]] += level
    return InitialState(state, f"in motion, from the {len(before) * before.sample_time:.3g} s before it")


def _scale_and_bias(plant: Plant, channel: str) -> tuple[float, float]:
    sensor = plant.sensors.get(channel)
    return (sensor.scale, sensor.bias) if sensor else (1.0, 0.0)
