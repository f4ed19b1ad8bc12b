"""Magnetic saturation: at high current the torque is less than K_T I.

T_M = K_T I / (1 + (k_sat I)^2), 3 % less at k_sat I = 0.17. The form is assumed: smooth, odd in I, with a torque
constant that falls monotonically. Data sheets (Kollmorgen AKM) only state that torque is proportional up to about twice
the continuous current.
"""

from ._effect import Effect, EffectParameter


def torque(T_M: float, current: float, k_sat: float) -> float:
    """T_M / (1 + (k_sat I)^2)."""
    return T_M / (1.0 + (k_sat * current) * (k_sat * current))


effect = Effect(
    name="torque_saturation",
    place="torque",
    summary="the torque constant falls with the current",
    fingerprint="torque error only at high current, odd in the current",
    changes={"T_M": torque},
    parameters=(
        EffectParameter("k_sat", "1/A", "T_M = K_T I / (1 + (k_sat I)^2)", 0.0, 0.1, 0.0, 1.0, detectable=0.05),
    ),
    source="form assumed; data sheets give the limit of proportionality",
)
