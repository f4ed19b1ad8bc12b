"""Multiple shooting: windows of a log that are simulated from initial states of their own.

In short windows the simulation can't diverge far from the measurement, so that the cost tolerates wrong parameters.
Long windows show what small errors accumulate to. One sample gives one-step prediction, the whole log its free run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ..core.log import Log
from ..plant.plant import Plant
from .initial_state import ZERO_SPEED, StateEstimate, estimate_states

#: Samples before and after the first one of a window over which motion or rest has to be unambiguous.
UNAMBIGUOUS = 6


@dataclass(frozen=True)
class ShootingWindow:
    """Samples first to last (included) of a log, and the estimated state at its first sample.

    start (n,): initial state. free: indices of the states that are fitted; the others are known (zero speed while a
    contact sticks). spread (n,): prior standard deviation of a free state, infinite where it is measured.
    """

    log: Log
    first: int
    last: int
    start: np.ndarray
    free: tuple[int, ...]
    spread: np.ndarray

    def __len__(self) -> int:
        return self.last - self.first + 1


def shooting_windows(plant: Plant, log: Log, length: float | None) -> list[ShootingWindow]:
    """Cut a log into windows of about `length` seconds; None makes one window of all of it.

    A window begins where each contact clearly slides or clearly sticks: near standstill sensors can't tell a creeping
    rod from one that is held, and the simulation would start in the wrong one of two different modes.
    """
    estimate = estimate_states(plant, log)
    samples = len(log)
    per_window = samples if length is None else max(int(round(length / log.sample_time)), 2)
    count = max(samples // per_window, 1)
    fine = _unambiguous(plant, estimate)
    edges = [0]
    for wanted in np.linspace(0, samples - 1, count + 1)[1:-1].astype(int):
        near = wanted + np.arange(-per_window // 3, per_window // 3 + 1)
        near = near[(near > edges[-1] + 1) & (near < samples - 2)]
        near = near[fine[near]]
        if near.size:
            edges.append(int(near[np.argmin(np.abs(near - wanted))]))
    ends = [*edges[1:], samples - 1]
    return [_window(plant, log, estimate, first, last) for first, last in zip(edges, ends, strict=True)]


def _unambiguous(plant: Plant, estimate: StateEstimate) -> np.ndarray:
    """(N,) bool: every contact slides at a steady speed, or rests, for some samples before and after."""
    fine = np.ones(len(estimate.values), dtype=bool)
    around = 2 * UNAMBIGUOUS + 1
    for contact in plant.structure.system.contacts:
        if not plant.structure.law(contact).sticks:
            continue
        column = plant.structure.equations.index(contact.velocity)
        speed, sd = estimate.values[:, column], estimate.sd[:, column]
        rests = maximum_filter1d(np.abs(speed) / sd, around) < ZERO_SPEED
        change = maximum_filter1d(speed, around) - minimum_filter1d(speed, around)
        fine &= rests | ((change < 0.5 * np.abs(speed)) & (np.abs(speed) > 3 * ZERO_SPEED * sd))
    return fine


def _window(plant: Plant, log: Log, estimate: StateEstimate, first: int, last: int) -> ShootingWindow:
    start = estimate.values[first].copy()
    states = plant.structure.equations.states
    measured = {state for channel, state in plant.structure.system.outputs.items() if channel in log.channels}
    free = [i for i, state in enumerate(states) if not state.name.startswith("z_")]
    spread = np.where([state.name in measured for state in states], np.inf, 10.0 * estimate.sd[first])
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        at_rest = abs(start[column]) < ZERO_SPEED * estimate.sd[first, column]
        if at_rest and (plant.structure.law(contact).sticks or first == 0):
            start[column] = 0.0
            free.remove(column)
    return ShootingWindow(log, first, last, start, tuple(free), spread)
