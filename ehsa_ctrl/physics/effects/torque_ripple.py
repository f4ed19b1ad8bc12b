"""Cogging: a torque that is periodic in the shaft's angle.

T_M + T_c sin(n_c theta + phi_c); theta is the shaft's angle since the start.
"""

from math import sin

from ._effect import Effect, EffectParameter, EffectState


def torque(T_M: float, theta: float, T_c: float, n_c: float, phi_c: float) -> float:
    """T_M + T_c sin(n_c theta + phi_c)."""
    return T_M + T_c * sin(n_c * theta + phi_c)


def angle_rate(omega: float, T_c: float) -> float:
    """d theta/dt = omega; the angle is not counted while there is no ripple."""
    return omega if T_c != 0.0 else 0.0


effect = Effect(
    name="torque_ripple",
    place="torque",
    summary="cogging torque, periodic in the shaft's angle",
    fingerprint="torque error periodic in the shaft's angle, visible at low speed",
    changes={"T_M": torque},
    parameters=(
        EffectParameter("T_c", "N m", "amplitude", 0.0, 0.05, 0.0),
        EffectParameter("n_c", "1", "periods per turn", 36.0, 36.0, 1.0, 200.0),
        EffectParameter("phi_c", "rad", "phase at the start", 0.0, 0.0, -7.0, 7.0),
    ),
    states=(EffectState("theta", "rad", 1.0),),
    adds={"theta_dot": angle_rate},
    source="textbook form",
)
