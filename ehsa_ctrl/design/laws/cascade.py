"""Position over speed: an outer P or PI on the rod's position asks an inner PI on the shaft's speed.

    omega_r = (f v_r + k_x (r - x) + k_ix int (r - x) dt) / n,    limited to +-speed_limit
    u = k_w (omega_r - omega) + k_iw int (omega_r - omega) dt,    limited to +-current_limit

n is the rod's way per radian of the shaft, f the share of the velocity that is fed forward. The classic structure of
servo drives (e.g. W. Leonhard, "Control of Electrical Drives", 3rd ed. 2001, chapter 7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import INPUTS

if TYPE_CHECKING:
    import control


def cascade_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: k_x, k_ix, 1 / n, f, speed_limit, k_w, k_iw, current_limit, rate of back-calculation [1/s], sample time.
    memory: integral of the speed loop [A], integral of the position loop [m/s], speed asked for [rad/s].
    """
    k_x, k_ix, per_metre, f, fastest, k_w, k_iw, limit, back, T_s = settings
    error = reference[0] - measured[3]
    asked = per_metre * (f * reference[1] + k_x * error + memory[1])
    memory[2] = min(max(asked, -fastest), fastest)
    wanted = k_w * (memory[2] - measured[0]) + memory[0] + extra
    current = min(max(wanted, -limit), limit)
    if hold == 0.0:
        # The outer integral waits while the speed it asks for, or the current that makes it, is limited its way.
        if (asked - memory[2]) * error <= 0.0 and (wanted - current) * error <= 0.0:
            memory[1] += T_s * k_ix * error
        memory[0] += T_s * (k_iw * (memory[2] - measured[0]) + back * (current - wanted))
    return current


@dataclass(frozen=True)
class Cascade:
    """Position over speed, a design.law.Law.

    Attributes
    ----------
    k_x [1/s], k_ix [1/s2]: of the position. k_w [A s/rad], k_iw [A/rad]: of the speed.
    n: rod's way per radian of the shaft [m]. f: share of the velocity that is fed forward.
    speed_limit: rad/s. current_limit: A. sample_time: s.
    """

    k_x: float
    k_ix: float
    k_w: float
    k_iw: float
    n: float
    f: float
    speed_limit: float
    current_limit: float
    sample_time: float
    function = staticmethod(cascade_law)
    uses = ()
    compiles = True
    reads = ("position", "speed")
    traces = {"integral": 0, "speed_reference": 2}

    def settings(self) -> np.ndarray:
        # Back-calculation as fast as the speed loop's own integral, at most within a sample.
        back = min(self.k_iw / self.k_w, 1.0 / self.sample_time)
        outer = [self.k_x, self.k_ix, 1.0 / self.n, self.f, self.speed_limit]
        return np.array([*outer, self.k_w, self.k_iw, self.current_limit, back, self.sample_time])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(3)

    def linear(self) -> control.StateSpace:
        """States: integral of the speed loop [A], of the position loop [m/s]."""
        import control

        T_s, inputs = self.sample_time, list(INPUTS)
        error, asked = np.zeros(len(inputs)), np.zeros(len(inputs))
        error[inputs.index("reference_position")], error[inputs.index("position")] = 1.0, -1.0
        asked += self.k_x * error
        asked[inputs.index("reference_velocity")] = self.f
        gap = asked / self.n
        gap[inputs.index("speed")] -= 1.0
        a = np.array([[1.0, T_s * self.k_iw / self.n], [0.0, 1.0]])
        b = np.array([T_s * self.k_iw * gap, T_s * self.k_ix * error])
        c = np.array([[1.0, self.k_w / self.n]])
        return control.ss(a, b, c, (self.k_w * gap)[None, :], T_s, inputs=inputs, outputs=["current"])

    def __str__(self) -> str:
        return (
            f"position over speed, k_x = {self.k_x:.4g} 1/s, k_ix = {self.k_ix:.4g} 1/s2, "
            f"k_w = {self.k_w:.4g} A s/rad, k_iw = {self.k_iw:.4g} A/rad"
        )
