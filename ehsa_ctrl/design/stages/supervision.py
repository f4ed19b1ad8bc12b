"""Supervision: what a controller does when a sensor can't be trusted.

A reading that is lost (not a number) is replaced by the last good one for a while; a loss that lasts, a reading out of
its range, or a position and a speed that contradict each other stop the loop: from then on the current is zero. The
actuator locks itself by friction then, which is why zero is the safe output here.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from ...core.controller_interface import MEASURED

#: What the trace `status` of a controller says.
STATUS = {0.0: "sound", 1.0: "a lost reading is replaced by the last good one", 2.0: "stopped: the current is zero"}
#: Numbers of memory and of settings that `supervise` has.
MEMORY, SETTINGS = 14, 13


def supervise(measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """One sample: fills memory[1:6] with the readings to be trusted and returns the status (see STATUS).

    settings: samples a reading may be lost; largest |position| and |speed|; least and largest pressure; largest
    contradiction of position and speed [m]; rod travel per shaft angle [m/rad]; share of the contradiction that is
    kept from sample to sample; sample time; and for speed, p1, p2, position whether a loss counts.
    memory: status, trusted readings (5), samples lost (5), contradiction [m], and position and speed before.
    """
    lost_allowed, x_max, omega_max, p_min, p_max, apart, travel, kept, T_s = settings[:9]
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
    # Both are wanted at the same time: the difference of what the position says and what the speed says, leaking
    # slowly, so that leakage and the oil's compression don't add up.
    if memory[0] >= 0.0:
        memory[11] = kept * memory[11] + (x - memory[12]) - 0.5 * travel * T_s * (omega + memory[13])
    if abs(memory[11]) > apart:
        status = 2.0
    memory[12], memory[13] = x, omega
    memory[0] = status
    return status


@dataclass(frozen=True)
class Supervision:
    """Limits of what a controller takes for possible; the defaults only watch for readings that are lost.

    Attributes
    ----------
    lost: s, how long a reading may be lost before the loop stops.
    position, speed: largest size [m], [rad/s].
    pressure_min, pressure_max: Pa.
    contradiction: m, largest difference of the rod's position and what the shaft's speed makes of it.
    travel: m/rad, rod travel per shaft angle D / A; needed for `contradiction`.
    memory_time: s, over which a contradiction is forgotten.
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
        """Numbers for `supervise`; `reads`: the channels whose loss counts."""
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
        memory[0] = -1.0  # no sample yet: nothing to hold the first position against
        return memory
