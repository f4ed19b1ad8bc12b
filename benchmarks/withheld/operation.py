"""How a case drives the bench, and whether it stays within the bench's limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import excitation
import numpy as np
from cause import Bench
from plant import Run, simulate

ROD_LIMIT, LOWEST_PRESSURE, SPEED_LIMIT = 0.09, -0.9e5, 520.0  # m, Pa, rad/s
CENTRING_GAINS = (0.5, 20.0, 0.0)  # s, A/m


@dataclass(frozen=True)
class Operation:
    """An excitation, open or with the slow centring loop, or a rod reference and a position controller."""

    loop: str
    shape: str
    reference: np.ndarray
    gains: tuple[float, ...]

    @staticmethod
    def draw(rng: np.random.Generator, family: str, n: int) -> Operation:
        if family == "closed_loop":
            gains = (rng.uniform(4e3, 1.2e4), rng.uniform(0.008, 0.02), rng.uniform(0.02, 0.2))
            return Operation("position", "moves and sine", excitation.reference(n, rng), gains)
        if family == "weak":
            shape, reference = excitation.weak(n, rng)
            return Operation("centring", shape, reference, CENTRING_GAINS)
        loop = "open" if rng.random() < 0.25 else "centring"
        return Operation(loop, "mixed", excitation.mixed(n, rng), CENTRING_GAINS)

    def run(self, bench: Bench, noise: Mapping[str, float], rng: np.random.Generator) -> Run:
        """The loop has its own encoder and potentiometer, with the bench's noise."""
        seen = rng.standard_normal((self.reference.size, 2)) * np.array([noise["speed"], noise["position"]])
        return simulate(bench.rig, self.reference, loop=self.loop, gains=self.gains, seen=seen)


def usable(run: Run) -> bool:
    """The rod moves and stays in its stroke, and no pressure falls below cavitation."""
    y = run.samples
    if not np.isfinite(y).all():
        return False
    fits = np.abs(y[:, 3]).max() < ROD_LIMIT and np.abs(y[:, 0]).max() < SPEED_LIMIT
    return bool(fits and y[:, 1:3].min() > LOWEST_PRESSURE and np.ptp(y[:, 3]) > 2e-4)
