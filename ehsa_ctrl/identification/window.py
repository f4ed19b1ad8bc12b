"""Pieces of a log that are simulated from a state of their own.

Short windows forgive wrong parameters: the simulation can't run away from the measurement. Long ones show what small
errors add up to. One sample long they are one-step prediction, as long as the log they are its free run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from ..core.log import Log
from ..plant.plant import Plant

#: Samples before and after the first one of a window over which its motion or rest has to be plain.
PLAIN = 6

#: A speed is taken for zero within this many standard deviations of its estimate.
REST = 4.0


@dataclass(frozen=True)
class Window:
    """Samples first to last (included) of a log, and what is known of the state at its first sample.

    start: (n,) estimate. free: which states are fitted, the others are sure (a speed that is zero while it sticks).
    spread: (n,) how far the fit may move a free state, one standard deviation; infinite where measured.
    """

    log: Log
    first: int
    last: int
    start: np.ndarray
    free: tuple[int, ...]
    spread: np.ndarray

    def __len__(self) -> int:
        return self.last - self.first + 1


@dataclass(frozen=True)
class StateEstimate:
    """States over a log as its sensors show them, smoothed: values (N, n), sd (N, n) of each."""

    values: np.ndarray
    sd: np.ndarray


def estimate_states(plant: Plant, log: Log) -> StateEstimate:
    """States from the measured channels, without a model: parabolas over some samples, rod speed by their slope.

    A state that no channel shows takes its value at rest with its whole scale as spread.
    """
    states = plant.structure.equations.states
    shown = {state: channel for channel, state in plant.structure.system.outputs.items() if channel in log.channels}
    values = np.tile(plant.rest, (len(log), 1))
    sd = np.tile([state.scale for state in states], (len(log), 1))
    for column, state in enumerate(states):
        if state.name in shown:
            values[:, column], sd[:, column] = _smooth(plant, log, shown[state.name], LEVEL, 0)
        elif state.name == "v" and "x" in shown and len(log) >= 3:
            values[:, column], sd[:, column] = _smooth(plant, log, shown["x"], SLOPE, 1)
    return StateEstimate(values, sd)


#: Samples that a level and a slope are taken from: pressures change within some ms, a rod's speed hardly faster.
LEVEL, SLOPE = 7, 11


def _smooth(plant: Plant, log: Log, channel: str, width: int, derivative: int) -> tuple[np.ndarray, np.ndarray]:
    """Level or slope of a channel (N,) by parabolas over `width` samples, and its standard deviation (N,)."""
    sensor = plant.sensors[channel]
    measured = (log[channel] - sensor.bias) / sensor.scale
    width = min(width, len(log) - 1 + len(log) % 2)
    noise = sensor_sd(plant, log, channel) / sensor.scale
    if width < 3:
        return measured, np.full(len(log), noise)
    value = savgol_filter(measured, width, 2, deriv=derivative, delta=log.sample_time)
    half = width // 2
    # At the ends of the log the parabola of the first or last samples is read at its own end.
    spread = [
        float(np.linalg.norm(savgol_coeffs(width, 2, deriv=derivative, delta=log.sample_time, pos=position)))
        for position in range(width)
    ]
    sd = np.full(len(log), noise * spread[half])
    sd[:half], sd[len(log) - half :] = noise * np.array(spread[:half]), noise * np.array(spread[half + 1 :])
    return value, sd


def sensor_sd(plant: Plant, log: Log, channel: str) -> float:
    """Noise of a channel: what the plant says of its sensor, or else what the log shows from sample to sample.

    From the log: half the median of second differences, which a smooth signal hardly has.
    """
    declared = plant.sensors[channel].sd if channel in plant.sensors else 0.0
    if declared > 0.0:
        return declared
    second = np.abs(np.diff(log[channel], 2))
    found = float(np.median(second)) / 0.6745 / np.sqrt(6.0)
    return found if found > 0.0 else float(np.std(log[channel])) * 1e-3 or 1.0


def cut(plant: Plant, log: Log, length: float | None) -> list[Window]:
    """Cut a log into windows of about `length` seconds; None makes one window of all of it.

    A window begins where each contact plainly moves or plainly rests: near standstill the sensors can't tell a rod
    that creeps from one that is held, and the simulation would start from the wrong one of two different states.
    """
    estimate = estimate_states(plant, log)
    samples = len(log)
    per_window = samples if length is None else max(int(round(length / log.sample_time)), 2)
    count = max(samples // per_window, 1)
    plain = _plain(plant, estimate)
    edges = [0]
    for wanted in np.linspace(0, samples - 1, count + 1)[1:-1].astype(int):
        near = wanted + np.arange(-per_window // 3, per_window // 3 + 1)
        near = near[(near > edges[-1] + 1) & (near < samples - 2)]
        near = near[plain[near]]
        if near.size:
            edges.append(int(near[np.argmin(np.abs(near - wanted))]))
    ends = [*edges[1:], samples - 1]
    return [_window(plant, log, estimate, first, last) for first, last in zip(edges, ends, strict=True)]


def _plain(plant: Plant, estimate: StateEstimate) -> np.ndarray:
    """(N,) bool: every contact moves plainly and evenly, or rests plainly, for some samples before and after."""
    fine = np.ones(len(estimate.values), dtype=bool)
    around = 2 * PLAIN + 1
    for contact in plant.structure.system.contacts:
        if not plant.structure.law(contact).sticks:
            continue
        column = plant.structure.equations.index(contact.velocity)
        speed, sd = estimate.values[:, column], estimate.sd[:, column]
        most = maximum_filter1d(np.abs(speed) / sd, around)
        least = minimum_filter1d(speed, around), maximum_filter1d(speed, around)
        even = (least[1] - least[0] < 0.5 * np.abs(speed)) & (np.abs(speed) > 3 * REST * sd)
        fine &= even | (most < REST)
    return fine


def _window(plant: Plant, log: Log, estimate: StateEstimate, first: int, last: int) -> Window:
    start = estimate.values[first].copy()
    states = plant.structure.equations.states
    shown = {state for channel, state in plant.structure.system.outputs.items() if channel in log.channels}
    free = [i for i, state in enumerate(states) if not state.name.startswith("z_")]
    spread = np.where([state.name in shown for state in states], np.inf, 10.0 * estimate.sd[first])
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(start[column]) < REST * estimate.sd[first, column] and (
            plant.structure.law(contact).sticks or first == 0
        ):
            start[column] = 0.0
            free.remove(column)
    return Window(log, first, last, start, tuple(free), spread)
