"""Supervision of the sensors.

The last valid reading replaces a lost one (not a number) for a limited time. A longer loss, a reading out of range, or
a position inconsistent with the speed stops the loop: from then on the current is zero. Zero is the safe output,
because friction then locks the actuator.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from ...core.controller_interface import MEASURED

#: Trace `status` of a controller.
STATUS = {0.0: "all readings valid", 1.0: "the last valid reading replaces a lost one", 2.0: "stopped: zero current"}
#: Sizes of memory and settings of `supervise`.
MEMORY, SETTINGS = 14, 13


def supervise(measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """One sample: writes the validated readings to memory[1:6] and returns the status (see STATUS).

    settings: samples for which a reading may be lost; largest |position| and |speed|; least and largest pressure;
    largest discrepancy of position and speed [m]; rod travel per shaft angle [m/rad]; decay of the discrepancy per
    sample; sample time; for speed, p1, p2, position 1 if a loss counts.
    memory: status, validated readings (5), samples lost (5), discrepancy [m], last position and speed.
    """
    lost_allowed, x_max, omega_max, p_min, p_max, max_discrepancy, travel, decay, T_s = settings[:9]
    if memory[0] == 2.0:
        return 2.0
    status = 0.0
    for i in range(5):
        if isfinite(measured[i]):
            memory[1 + i] = measured[i]
            memory[6 + i] = 0.0
        else:
            memory[6 + i] += 1.0
            if i < 4 and settings[9 + i] > 0.0:
                status = max(status, 2.0 if memory[6 + i] > lost_allowed else 1.0)
    omega, x = memory[1], memory[4]
    if abs(omega) > omega_max or abs(x) > x_max:
        status = 2.0
    if min(memory[2], memory[3]) < p_min or max(memory[2], memory[3]) > p_max:
        status = 2.0
    # Measured travel minus that of the shaft speed, with a slow decay, so that leakage and compressibility don't
    # accumulate.
    if memory[0] >= 0.0:
        memory[11] = decay * memory[11] + (x - memory[12]) - 0.5 * travel * T_s * (omega + memory[13])
    if abs(memory[11]) > max_discrepancy:
        status = 2.0
    memory[12], memory[13] = x, omega
    memory[0] = status
    return status


@dataclass(frozen=True)
class Supervision:
    """Plausibility limits of the readings; by default only lost readings are detected.

    Attributes
    ----------
    lost: s, for which a reading may be lost before the loop stops.
    position, speed: largest magnitude [m], [rad/s].
    pressure_min, pressure_max: Pa.
    contradiction: m, largest discrepancy of the rod travel and the integrated shaft speed.
    travel: m/rad, rod travel per shaft angle D / A; needed for `contradiction`.
    memory_time: s, time constant with which the discrepancy decays.
    """

    lost: float = 0.04
    position: float = inf
    speed: float = inf
    pressure_min: float = -inf
    pressure_max: float = inf
    contradiction: float = inf
    travel: float = 0.0
    memory_time: float = 0.25

    def settings(self, sample_time: float, reads: tuple[str, ...]) -> np.ndarray:
        """Settings of `supervise`; `reads`: the channels whose loss counts."""
        return np.array(
            [
                np.floor(self.lost / sample_time + 1e-9),
                self.position,
                self.speed,
                self.pressure_min,
                self.pressure_max,
                self.contradiction,
                self.travel,
                np.exp(-sample_time / self.memory_time),
                sample_time,
                *(float(channel in reads) for channel in MEASURED[:4]),
            ]
        )

    def initial_memory(self) -> np.ndarray:
        memory = np.zeros(MEMORY)
        memory[0] = -1.0  # no sample yet
        return memory
