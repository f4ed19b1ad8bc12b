"""The rod's speed from its position, for laws on a plant without a shaft."""

from __future__ import annotations

import numpy as np

#: Size of the memory of `take_rod_speed`.
MEMORY = 7


def take_rod_speed(measured: np.ndarray, memory: np.ndarray, T_f: float, T_s: float) -> None:
    """One sample: memory[2:7] become the readings with the rod's speed [m/s] in place of the shaft's.

    The speed is the filtered difference of the position, (z - 1) / ((T_f + T_s) z - T_f), that of a PID's derivative.

    T_f: time constant of the filter [s]. T_s: sample time. memory: 1 after the first sample, last position, readings
    (5).
    """
    if memory[0] == 0.0:
        memory[0], memory[1] = 1.0, measured[3]
    memory[2] = (T_f * memory[2] + measured[3] - memory[1]) / (T_f + T_s)
    memory[1] = measured[3]
    for i in range(1, 5):
        memory[2 + i] = measured[i]
