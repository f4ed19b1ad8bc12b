"""Drag of the fluid around the shaft, air or churned oil: torque k_w omega |omega| against the motion."""

from ._effect import Effect, EffectParameter


def net_torque(T_net: float, omega: float, k_w: float) -> float:
    """T_net - k_w omega |omega|, zero at standstill."""
    return T_net - k_w * omega * abs(omega)


effect = Effect(
    name="windage",
    place="torque",
    summary="drag on the shaft that grows with the square of its speed",
    fingerprint="torque error ~ omega |omega|: negligible at low speed, while that of viscous friction is linear",
    changes={"T_net": net_torque},
    parameters=(EffectParameter("k_w", "N m s2", "torque k_w omega |omega|", 0.0, 1e-6, 0.0, 1e-3, detectable=2e-7),),
    source="turbulent drag of a rotating body, as in textbooks of fluid mechanics",
)
