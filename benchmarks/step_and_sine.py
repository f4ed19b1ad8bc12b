"""Two motions of a closed loop that several benchmarks measure: a step there and back, and a sine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

import ehsa_ctrl as e
from ehsa_ctrl.design.controller import SampledController
from ehsa_ctrl.scenario.response import settling_band, step_metrics
from ehsa_ctrl.simulation.minimum_time import shortest_time
from ehsa_ctrl.simulation.sensors import Sensors

#: Sample time, and time from a step until the rod counts as held [s].
DT, WAIT = 0.004, 1.5


@dataclass(frozen=True)
class Leg:
    """One of two steps.

    metrics: of `step_metrics`. ratio: settling time over the shortest one that the current limit allows. standing:
    largest error while held [m]. current: RMS [A]. time [s], x [m]: (N,) while held.
    """

    metrics: Mapping[str, float]
    ratio: float
    standing: float
    current: float
    time: np.ndarray
    x: np.ndarray


def step_and_back(law: SampledController, plant: e.Plant, size: float, *, seed: int, hold: float) -> Iterator[Leg]:
    """A step to `size` [m] and one back, each held for `hold` [s] after WAIT."""
    part = round((WAIT + hold) / DT)
    reference = np.zeros((50 + 2 * part, 3))
    reference[50 : 50 + part, 0] = size
    run = e.run_closed_loop(plant, law, reference, sensors=Sensors.of(plant, seed=seed)).trajectory
    time, x = run.time, run["x"]
    for first, before, target in ((50, 0.0, size), (50 + part, size, 0.0)):
        moving, held = slice(first, first + part), slice(first + round(WAIT / DT), first + part)
        metrics = step_metrics(time[moving], x[moving], before, target)
        least = shortest_time(plant, target - before, law.current_limit, start=before, band=size * settling_band(size))
        standing = float(np.max(np.abs(x[held] - target)))
        current = float(np.sqrt(np.mean(run.current[moving] ** 2)))
        yield Leg(metrics, metrics["SettlingTime"] / least, standing, current, time[held], x[held])


def sine_error(law: SampledController, plant: e.Plant, *, seed: int = 0) -> float:
    """RMS error [m] from the second period on in a sine of 1 Hz and 10 mm."""
    t, w = DT * np.arange(round(5 / DT)), 2 * np.pi
    reference = 0.01 * np.column_stack([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)])
    loop = e.run_closed_loop(plant, law, reference, sensors=Sensors.of(plant, seed=seed))
    return float(np.sqrt(np.mean(loop.error[round(1 / DT) :] ** 2)))
