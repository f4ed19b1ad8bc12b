"""The feedback law of an impedance controller.

    M d'' + B d' + K d = -F
    u = k_x (r + d - x) + k_xi int (r + d - x) dt + k_xw ((v_r + d') / n - omega) + inertia d'' + viscous d' + friction

limited to +-current_limit. d is the deviation from the reference r by which a mass-damper-spring would yield to the
measured force F, positive where it resists extension; n the rod's travel per radian of the shaft. This is impedance
control based on a position loop (N. Hogan, "Impedance control: an approach to manipulation", J. Dyn. Syst. Meas.
Control 107, 1985): friction, which hides a force from the current, is inside the position loop. The deviation is
sampled exactly for a force that is held over each sample.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.closed_loop import law_state_space
from ..analysis.robustness import RobustMargins
from ..review_checks import ReviewContext, ReviewFinding
from ._force_law import LoopGains, contact_findings, contact_words

if TYPE_CHECKING:
    import control


def impedance_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: k_x, k_xi, k_xw, 1 / n; the deviation's transition (2 x 2, row by row) and input (2); M, B, K; inertia
    [A s2/m], viscous [A s/m], friction [A] and the speed at which it acts in full [m/s]; current_limit,
    back-calculation rate [1/s], sample time.
    memory: d [m], d' [m/s], integral [A].
    """
    k_x, k_xi, k_xw, per_metre = settings[0], settings[1], settings[2], settings[3]
    M, B, K = settings[10], settings[11], settings[12]
    inertia, viscous, friction, slow = settings[13], settings[14], settings[15], settings[16]
    limit, back, T_s = settings[17], settings[18], settings[19]
    force, d, speed = measured[4], memory[0], memory[1]
    acceleration = -(force + B * speed + K * d) / M
    error = reference[0] + d - measured[3]
    wanted = k_x * error + k_xw * (per_metre * (reference[1] + speed) - measured[0]) + memory[2] + extra
    wanted += inertia * acceleration + viscous * speed
    if reference[1] == 0.0:
        # During a planned motion the friction is in `extra`.
        wanted += friction * min(max(speed / slow, -1.0), 1.0)
    current = min(max(wanted, -limit), limit)
    memory[2] += T_s * (k_xi * error + back * (current - wanted))
    memory[0] = settings[4] * d + settings[5] * speed - settings[8] * force
    memory[1] = settings[6] * d + settings[7] * speed - settings[9] * force
    return current


@dataclass(frozen=True)
class Impedance:
    """A mass-damper-spring between the reference and the rod.

    mass: kg. damping: N s/m. stiffness: N/m, 0 for a rod that does not return.
    """

    mass: float
    damping: float
    stiffness: float

    def sampled(self, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
        """Transition (2, 2) and input (2,) of (d, d') [m, m/s] for a force [N] that yields and is held."""
        from scipy.signal import cont2discrete

        a = np.array([[0.0, 1.0], [-self.stiffness / self.mass, -self.damping / self.mass]])
        parts = cont2discrete((a, np.array([[0.0], [1.0 / self.mass]]), np.eye(2), np.zeros((2, 1))), sample_time)
        return np.asarray(parts[0]), np.asarray(parts[1])[:, 0]


@dataclass(frozen=True)
class ImpedanceLaw:
    """Feedback law of an impedance controller, a design.controller.Law.

    Attributes
    ----------
    impedance: what the rod shall behave as. position: gains of the position loop, A/m.
    n: rod travel per radian of the shaft [m]. stiffness: of the environment of the design [N/m].
    inertia [A s2/m], viscous [A s/m], friction [A]: currents of the deviation's motion.
    slow: speed at which friction acts in full [m/s]. current_limit: A. sample_time: s.
    margins: over the stiffness of the environment.
    """

    impedance: Impedance
    position: LoopGains
    n: float
    stiffness: float
    inertia: float
    viscous: float
    friction: float
    slow: float
    current_limit: float
    sample_time: float
    margins: RobustMargins | None = field(default=None, repr=False, compare=False)
    function = staticmethod(impedance_law)
    uses = ()
    compiles = True
    reads = ("speed", "position", "force")
    traces = {"deviation": 0, "deviation_velocity": 1, "integral": 2}

    def settings(self) -> np.ndarray:
        x, z = self.position, self.impedance
        transition, entry = z.sampled(self.sample_time)
        return np.array(
            [
                *(x.k, x.k_i, x.k_w, 1.0 / self.n, *transition.ravel(), *entry, z.mass, z.damping, z.stiffness),
                *(self.inertia, self.viscous, self.friction, self.slow),
                *(self.current_limit, min(x.k_i / x.k, 1.0 / self.sample_time), self.sample_time),
            ]
        )

    def initial_memory(self) -> np.ndarray:
        return np.zeros(3)

    def linear(self) -> control.StateSpace:
        """The law without limit and friction."""
        return law_state_space(replace(self, current_limit=inf, friction=0.0), self.sample_time)

    def __str__(self) -> str:
        z = self.impedance
        text = (
            f"mass {z.mass:.4g} kg, damping {1e-3 * z.damping:.4g} kN s/m, stiffness {1e-3 * z.stiffness:.4g} kN/m "
            f"towards the load cell's force, k_x = {self.position.k:.4g} A/m, k_xw = {self.position.k_w:.4g} A s/rad"
        )
        return text if self.margins is None else f"{text}, {contact_words(self.margins)}"

    def findings(self, case: ReviewContext) -> Iterator[ReviewFinding]:
        """What a design review says of the environment."""
        yield from contact_findings(self)
