"""How a case drives the bench, and whether it stays within the bench's limits."""

from __future__ import annotations

from dataclasses import dataclass

import cycles
import excitation
import numpy as np
from cause import Bench
from family import RIG_FAMILIES
from plant import SAMPLE, Run, simulate
from sensors import POSITION_STEP, Sensors

ROD_LIMIT, LOWEST_PRESSURE, SPEED_LIMIT = 0.09, -0.9e5, 520.0  # m, Pa, rad/s
CENTRING_GAINS = (0.5, 20.0, 0.0)  # s, A/m
#: Share of the cases of each family that run under a PID.
PID_SHARE = {
    "nominals_off": 0.4, "rig_loop": 1.0, "other_form": 0.5, "several": 0.5, "production": 0.8, "outside_rig": 0.7,
}  # fmt: skip


@dataclass(frozen=True)
class Operation:
    """An excitation, open or with the slow centring loop, or a rod reference and a position controller or PID."""

    loop: str
    shape: str
    reference: np.ndarray
    gains: tuple[float, ...]
    lead: int = 0  # samples between rest and the begin of the log

    @staticmethod
    def draw(
        rng: np.random.Generator, family: str, n: int, spring: bool = False, step: float = POSITION_STEP
    ) -> Operation:
        """`step` [m]: of the encoder that a PID reads."""
        if family in RIG_FAMILIES:
            return Operation._of_a_rig(rng, family, n, spring, step)
        if family == "closed_loop":
            gains = (rng.uniform(4e3, 1.2e4), rng.uniform(0.008, 0.02), rng.uniform(0.02, 0.2))
            return Operation("position", "moves and sine", excitation.reference(n, rng), gains)
        if family == "weak":
            shape, reference = excitation.weak(n, rng)
            return Operation("centring", shape, reference, CENTRING_GAINS)
        loop = "open" if rng.random() < 0.25 else "centring"
        return Operation(loop, "mixed", excitation.mixed(n, rng), CENTRING_GAINS)

    @staticmethod
    def _of_a_rig(rng: np.random.Generator, family: str, n: int, spring: bool, step: float) -> Operation:
        """A PID around the rod or a current; one log in three begins in motion."""
        lead = int(rng.uniform(1.0, 4.0) / SAMPLE) if rng.random() < 1 / 3 else 0
        if rng.random() >= PID_SHARE[family]:
            return Operation("centring", "mixed", excitation.mixed(n + lead, rng), CENTRING_GAINS, lead)
        shape = str(rng.choice(["moves", "press"] if family == "production" else ["moves", "press", "sine"]))
        # A stiff spring leaves less stroke before a pressure falls to cavitation.
        reach = rng.uniform(0.008, 0.016) if spring else rng.uniform(0.015, 0.035)
        gains = (
            rng.uniform(200.0, 350.0), rng.uniform(100.0, 450.0), rng.uniform(8.0, 16.0), rng.uniform(0.006, 0.01),
            6.0, step, rng.choice([1e-4, 4e-4]), rng.uniform(0.5, 1.0),
        )  # fmt: skip
        return Operation("PID", shape, cycles.reference(shape, n + lead, reach, rng), gains, lead)

    def run(self, bench: Bench, sensors: Sensors, rng: np.random.Generator) -> Run:
        """From rest on. The loop has its own encoder and position sensor, with the noise of the logged ones."""
        seen = rng.standard_normal((self.reference.size, 2)) * np.array(
            [sensors.noise["speed"], sensors.noise["position"]]
        )
        return simulate(bench.rig, self.reference, loop=self.loop, gains=self.gains, seen=seen)


def usable(run: Run) -> bool:
    """The rod moves and stays in its stroke, and no pressure falls below cavitation."""
    y = run.samples
    if not np.isfinite(y).all():
        return False
    fits = np.abs(y[:, 3]).max() < ROD_LIMIT and np.abs(y[:, 0]).max() < SPEED_LIMIT
    return bool(fits and y[:, 1:3].min() > LOWEST_PRESSURE and np.ptp(y[:, 3]) > 2e-4)
