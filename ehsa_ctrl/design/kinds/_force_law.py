"""The feedback law of a force controller.

    force      u = F_t / G_0 + k_f (F_t - F) + k_fi int (F_t - F) dt - k_fw omega + friction sign(dF_t / dt)
    position   u = k_x (r - x) + k_xi int (r - x) dt + k_xw (v_r / n - omega)

both limited to +-current_limit. F_t follows the force target at a limited rate; G_0 is the static force per current,
n the rod's travel per radian of the shaft. At a switch the current does not step (bumpless transfer, K. J. Astrom,
T. Hagglund, "Advanced PID Control", ISA 2006): what it would step by is added and decays within the time constant of
the new loop's crossover. It is not put into the integral, which would cancel the damping of the rod that arrives for
the slow time of the integral. From contact on the force is controlled until its target returns to zero.

Friction holds shaft and rod where the target stops. An error beyond the deadband must first turn the friction round, so
the integral then also grows by the friction's current in friction_time. What it has gathered at a constant target is
friction, which is fed forward as soon as the target moves: a new motion begins with the integral of the last one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.closed_loop import law_state_space
from ..analysis.robustness import RobustMargins
from ..review_checks import MAX_MS, ReviewContext, ReviewFinding

if TYPE_CHECKING:
    import control


def force_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: k_x, k_xi, k_xw, 1 / n, contact [N]; k_f, k_fi, k_fw, 1 / G_0, friction [A], limit [N], change of the
    target per sample [N], area [m2] (0 for the load cell), deadband [N]; current_limit, back-calculation rates of
    position and force [1/s], sample time, decay per sample after a switch to position and to force, rate against
    friction at a constant target [A/s].
    memory: 1 while the force is controlled, integral [A], F_t [N], last current [A], measured force [N], what is left
    of the step avoided at the last switch [A], integral at the end of the last motion of the target [A], last change of
    the target [N].
    """
    k_x, k_xi, k_xw, per_metre, contact = settings[0], settings[1], settings[2], settings[3], settings[4]
    k_f, k_fi, k_fw, per_force, friction = settings[5], settings[6], settings[7], settings[8], settings[9]
    most, change, area, deadband = settings[10], settings[11], settings[12], settings[13]
    limit, back_x, back_f, T_s = settings[14], settings[15], settings[16], settings[17]
    decay_x, decay_f, seek = settings[18], settings[19], settings[20]
    force = area * (measured[1] - measured[2]) if area > 0.0 else measured[4]
    memory[4] = force
    asked = min(max(reference[3], -most), most)
    before = memory[0]
    if k_x > 0.0:
        if asked == 0.0:
            memory[0] = 0.0
        elif (force if asked > 0.0 else -force) >= contact:
            memory[0] = 1.0
    if memory[0] == 1.0:
        if before == 0.0:
            memory[2] = force
        move = min(max(asked - memory[2], -change), change)
        memory[2] += move
        error = memory[2] - force
        without = per_force * memory[2] + k_f * error - k_fw * measured[0]
        if move != 0.0:
            without += friction if move > 0.0 else -friction
            if memory[7] == 0.0:
                memory[1] = memory[6]
        memory[7] = move
        pauses = move == 0.0 and abs(error) <= deadband
        k_i, back, decay = k_fi, back_f, decay_f
    else:
        error = reference[0] - measured[3]
        without = k_x * error + k_xw * (per_metre * reference[1] - measured[0]) + extra
        pauses = False
        k_i, back, decay = k_xi, back_x, decay_x
    memory[5] *= decay
    if memory[0] != before:
        # Bumpless: this sample keeps the current of the last one.
        memory[1] = 0.0
        memory[6] = 0.0
        memory[5] = memory[3] - without
    wanted = without + memory[1] + memory[5]
    current = min(max(wanted, -limit), limit)
    if not pauses:
        rate = k_i * error + back * (current - wanted)
        if memory[0] == 1.0 and memory[7] == 0.0:
            rate += seek if error > 0.0 else -seek
        memory[1] += T_s * rate
    if memory[7] != 0.0:
        memory[6] = memory[1]
    memory[3] = current
    return current


@dataclass(frozen=True)
class LoopGains:
    """k: per error. k_i: per integral of the error. k_w [A s/rad]: of the shaft speed. crossover: rad/s."""

    k: float
    k_i: float
    k_w: float
    crossover: float


NO_LOOP = LoopGains(0.0, 0.0, 0.0, 0.0)


def contact_words(margins: RobustMargins) -> str:
    """The stiffnesses of an environment and the worst margins over them."""
    worst, labels = margins.worst, list(margins.loops)
    return (
        f"from {labels[0]} to {labels[-1]}: phase margin {worst['phase_margin'].value:.3g} deg or more, "
        f"Ms {worst['Ms'].value:.3g} or less"
    )


def contact_findings(law: Any) -> Iterator[ReviewFinding]:
    """The environment for which a law in contact is designed and reviewed, and its margins over other ones."""
    yield ReviewFinding(
        "environment", f"all figures are in contact with {1e-3 * law.stiffness:.5g} kN/m, of the design", "good"
    )
    if law.margins is not None:
        yield ReviewFinding(
            "margins in contact",
            contact_words(law.margins),
            "good" if law.margins.Ms <= MAX_MS else "warning",
            "lower the crossover, or narrow the range from softest to stiffest",
        )


@dataclass(frozen=True)
class ForceLaw:
    """Feedback law of a force controller, a design.controller.Law.

    Attributes
    ----------
    force: gains of the force loop, A/N. position: gains of the approach, A/m; NO_LOOP for none.
    stiffness: of the environment of the design [N/m]. G_0: static force per current [N/A].
    n: rod travel per radian of the shaft [m]. area: m2 where the force is measured by pressures, 0 for the load cell.
    contact, limit, deadband: N. rate: N/s. friction: A, fed forward while the target moves. friction_time: s.
    current_limit: A. sample_time: s.
    margins: of the force loop over the stiffness of the environment.
    """

    force: LoopGains
    position: LoopGains
    stiffness: float
    G_0: float
    n: float
    area: float
    contact: float
    limit: float
    rate: float
    deadband: float
    friction: float
    friction_time: float
    current_limit: float
    sample_time: float
    margins: RobustMargins | None = field(default=None, repr=False, compare=False)
    function = staticmethod(force_law)
    uses = ()
    compiles = True
    follows_force = True
    traces = {"force_mode": 0, "integral": 1, "force_target": 2, "force_reading": 4}

    @property
    def reads(self) -> tuple[str, ...]:
        force = ("p1", "p2") if self.area > 0.0 else ("force",)
        return ("speed", *force, *(("position",) if self.position != NO_LOOP else ()))

    def settings(self) -> np.ndarray:
        x, f = self.position, self.force
        return np.array(
            [
                *(x.k, x.k_i, x.k_w, 1.0 / self.n, self.contact),
                *(f.k, f.k_i, f.k_w, 1.0 / self.G_0, self.friction, self.limit, self.rate * self.sample_time),
                *(self.area, self.deadband, self.current_limit),
                *(min(loop.k_i / loop.k, 1.0 / self.sample_time) if loop.k > 0.0 else 0.0 for loop in (x, f)),
                self.sample_time,
                *(np.exp(-loop.crossover * self.sample_time) for loop in (x, f)),
                self.friction / self.friction_time,
            ]
        )

    def initial_memory(self) -> np.ndarray:
        memory = np.zeros(8)
        memory[0] = float(self.position == NO_LOOP)
        return memory

    def linear(self) -> control.StateSpace:
        """The force loop."""
        unlimited = replace(self, position=NO_LOOP, current_limit=inf, deadband=0.0, rate=0.0, friction=0.0)
        return law_state_space(unlimited, self.sample_time)

    def __str__(self) -> str:
        measurement = "A (P_1 - P_2)" if self.area > 0.0 else "load cell"
        text = (
            f"force by {measurement}, k_f = {1e3 * self.force.k:.4g} A/kN, k_fi = {1e3 * self.force.k_i:.4g} A/(kN s), "
            f"k_fw = {self.force.k_w:.4g} A s/rad"
        )
        if self.position != NO_LOOP:
            text += f", position before contact, k_x = {self.position.k:.4g} A/m"
        return text if self.margins is None else f"{text}, {contact_words(self.margins)}"

    def findings(self, case: ReviewContext) -> Iterator[ReviewFinding]:
        """What a design review says of the environment."""
        yield from contact_findings(self)
