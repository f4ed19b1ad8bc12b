"""Cogging: a torque that is periodic in the shaft's angle.

T_M + T_c sin(n_c theta + phi_c); theta is the shaft's angle since the start.
"""

from math import inf, sin

from ._candidate import Candidate, Free, Rig
from ._effect import Effect, EffectParameter, EffectState


def torque(T_M: float, theta: float, T_c: float, n_c: float, phi_c: float) -> float:
    """T_M + T_c sin(n_c theta + phi_c)."""
    return T_M + T_c * sin(n_c * theta + phi_c)


def angle_rate(omega: float, T_c: float) -> float:
    """d theta/dt = omega; the angle is not counted while there is no ripple."""
    return omega if T_c != 0.0 else 0.0


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """The order of a ripple can't be found by going downhill: it is read off the torque balance, angle by angle."""
    starts = tuple((amplitude, order, phase) for order, amplitude, phase in rig.ripples())
    if not starts:
        return []
    free = (
        Free("T_c", 0.0, 0.03, 0.0, inf),
        # Each start has its own.
        Free("n_c", starts[0][1], 1e-6, 1.0, 200.0, fixed=True),
        Free("phi_c", 0.0, 0.3, -7.0, 7.0),
    )
    return [Candidate(free, starts)]


effect = Effect(
    name="torque_ripple",
    place="torque",
    summary="cogging torque, periodic in the shaft's angle",
    fingerprint="torque error periodic in the shaft's angle, visible at low speed",
    changes={"T_M": torque},
    parameters=(
        EffectParameter("T_c", "N m", "amplitude", 0.0, 0.05, 0.0),
        EffectParameter("n_c", "1", "periods per turn", 36.0, 36.0, 1.0, 200.0, shape=True),
        EffectParameter("phi_c", "rad", "phase at the start", 0.0, 0.0, -7.0, 7.0, shape=True),
    ),
    states=(EffectState("theta", "rad", 1.0),),
    adds={"theta_dot": angle_rate},
    candidates=candidates,
    caveat="the torque ripple goes with the shaft's measured angle in these runs; in a run of the improved plant alone "
    "the angle drifts, and the ripple with it, so that such a run shows its size and not its phase",
    source="textbook form",
)
