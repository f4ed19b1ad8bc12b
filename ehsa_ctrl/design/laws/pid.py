"""The feedback law of a PID: one sample of it as text that is compiled, and what it is without limits.

    u = k_p (b r - y) + k_i int (r - y) dt + k_d s / (1 + T_f s) (c r - y),    then limited to +-current_limit

After K. J. Astrom, T. Hagglund, "Advanced PID Control", ISA 2006 (form, filter, weights, anti-windup).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import INPUTS, MEASURED
from .pid_forms import Gains

if TYPE_CHECKING:
    import control


def pid_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: k_p, k_i, k_d, T_f, b, c, current_limit, rate of back-calculation [1/s], 1 for conditional integration,
    sample time. memory: integral part [A], filtered derivative part [A], c r - y of the last sample, whether there was
    one, and the integral part that the last motion ended with [A].
    """
    k_p, k_i, k_d, T_f, b, c, limit, back, conditional, T_s = settings
    r, y = reference[0], measured[3]
    if memory[3] == 0.0:
        # Bumpless: as if the loop had rested at y, so that the weight b makes no step where r = y.
        memory[0] = k_p * (1.0 - b) * y if k_i != 0.0 else 0.0
        memory[2] = c * r - y
        memory[3] = 1.0
    if hold < 0.0:
        memory[0] = memory[4]
    # Backward differences: the filter stays stable and well damped for any ratio of T_f and sample time.
    memory[1] = (T_f * memory[1] + k_d * (c * r - y - memory[2])) / (T_f + T_s)
    memory[2] = c * r - y
    wanted = k_p * (b * r - y) + memory[0] + memory[1] + extra
    current = min(max(wanted, -limit), limit)
    if hold == 0.0:
        rate = k_i * (r - y)
        if conditional == 0.0 or (wanted - current) * rate <= 0.0:
            memory[0] += T_s * rate
        memory[0] += T_s * back * (current - wanted)
    if reference[1] != 0.0:
        memory[4] = memory[0]
    return current


@dataclass(frozen=True)
class Pid:
    """A position PID, a design.law.Law.

    Attributes
    ----------
    gains: parallel form.
    b, c: weights of the reference in the proportional and the derivative part.
    current_limit: A.
    T_t: time constant with which back-calculation draws the integral back while the current is limited [s]; inf: never.
    conditional: while the current is limited, the integral does not go further into the limit.
    sample_time: s.
    """

    gains: Gains
    b: float
    c: float
    current_limit: float
    T_t: float
    conditional: bool
    sample_time: float
    function = staticmethod(pid_law)
    uses = ()
    compiles = True
    reads = ("position",)
    traces = {"integral": 0}

    def settings(self) -> np.ndarray:
        g = self.gains
        return np.array(
            [
                g.k_p,
                g.k_i,
                g.k_d,
                g.T_f,
                self.b,
                self.c,
                self.current_limit,
                1.0 / self.T_t,
                float(self.conditional),
                self.sample_time,
            ]
        )

    def initial_memory(self) -> np.ndarray:
        return np.zeros(5)

    def linear(self) -> control.StateSpace:
        """States: integral [A], filtered derivative [A], c r - y before [m]."""
        import control

        g, T_s = self.gains, self.sample_time
        keep = g.T_f + T_s
        # Rows of r and y in the weighted differences of the three parts.
        error, proportional, derivative = np.array([1.0, -1.0]), np.array([self.b, -1.0]), np.array([self.c, -1.0])
        a = np.array([[1.0, 0.0, 0.0], [0.0, g.T_f / keep, -g.k_d / keep], [0.0, 0.0, 0.0]])
        b = np.array([T_s * g.k_i * error, g.k_d / keep * derivative, derivative])
        c = np.array([[1.0, g.T_f / keep, -g.k_d / keep]])
        d = g.k_p * proportional + g.k_d / keep * derivative
        wide = np.zeros((3, 8)), np.zeros((1, 8))
        for full, narrow in zip(wide, (b, d[None, :]), strict=True):
            full[:, [0, 3 + MEASURED.index("position")]] = narrow
        return control.ss(a, wide[0], c, wide[1], T_s, inputs=list(INPUTS), outputs=["current"])

    def __str__(self) -> str:
        return f"parallel PID, {self.gains}"
