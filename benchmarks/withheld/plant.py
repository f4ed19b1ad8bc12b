"""A run of the bench plant: input, loop and start in; samples and states out."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np
from kernel import integrate
from rig import Rig
from scipy.signal import lfilter

SAMPLE = 0.004  # s, 250 Hz
DENSE = 4  # points of each sample that the sensors see
STEPS = 80  # of 50 us in each sample
LOOPS = {"open": 0.0, "centring": 1.0, "position": 2.0, "PID": 3.0}


@dataclass(frozen=True)
class Run:
    """Result of a run.

    current: (N,) current command [A] at each sample. dense: (DENSE N + 1, 5) speed, port pressures 1 and 2, rod
    position, force in the load cell, every ms. states: (N + 1, 5) speed, P1, P2, v, x at the samples.
    """

    current: np.ndarray
    dense: np.ndarray
    states: np.ndarray

    @property
    def samples(self) -> np.ndarray:
        """(N, 5) readings of ideal sensors at the sample times."""
        return self.dense[:-1:DENSE]

    def after(self, k: int) -> Run:
        """The run from sample k on."""
        return Run(self.current[k:], self.dense[DENSE * k :], self.states[k:])


def _wander(n: int, seed: int) -> np.ndarray:
    """(N,) shape of a wandering force: a random walk with decay over some seconds, about unit standard deviation."""
    back = exp(-SAMPLE / 2.0)
    return lfilter([np.sqrt(1.0 - back * back)], [1.0, -back], np.random.default_rng(seed).standard_normal(n))


def simulate(
    rig: Rig,
    wanted: np.ndarray,
    *,
    loop: str = "open",
    gains: tuple[float, ...] = (0.5, 20.0, 0.0),
    seen: np.ndarray | None = None,
    start: np.ndarray | None = None,
    steps: int = STEPS,
) -> Run:
    """Run the rig.

    Parameters
    ----------
    wanted: (N,) current [A], held over each sample; under "position" and "PID" the rod position asked for [m].
    gains: "centring": time constant [s], pull [A/m]; "position": rad/s per m, A s/rad, A/rad;
        "PID": A/m, A/(m s), A s/m, filter [s], limit [A], encoder step [m], rest band [m],
        share of friction fed forward.
    seen: (N, 2) noise of speed and position in the loop's own sensors.
    start: (5,) speed, P1, P2, v, x; without it at rest in the middle, both chambers at P_0.
    steps: of integration in a sample, a multiple of 4.
    """
    wanted = np.ascontiguousarray(wanted, dtype=float)
    n = wanted.size
    seen = np.zeros((n, 2)) if seen is None else np.ascontiguousarray(seen)
    disturbance = _wander(n, int(rig.wander_seed)) if rig.wander else np.zeros(n)
    start = np.array([0.0, rig.P_0, rig.P_0, 0.0, 0.0]) if start is None else np.asarray(start, dtype=float)
    dense, states, current = np.empty((DENSE * n + 1, 5)), np.empty((n + 1, 5)), np.empty(n)
    rig = Rig(*map(float, rig))
    integrate(rig, LOOPS[loop], wanted, seen, np.array(gains), disturbance, start, steps, dense, states, current)
    return Run(current, dense, states)
