"""A displacement that falls with the pressure difference, because side plates and gears deform.

D (1 - k_D |P_1 - P_2|) replaces D in the flow (2) and in the torque (3), so that no energy is lost.
"""

from ._effect import Effect, EffectParameter


def flow(Q_P: float, omega: float, P_1: float, P_2: float, D: float, k_D: float) -> float:
    """Q_P - D omega k_D |P_1 - P_2|; the lost share is at most 1."""
    return Q_P - D * omega * min(k_D * abs(P_1 - P_2), 1.0)


def torque(T_P: float, P_1: float, P_2: float, k_D: float) -> float:
    """T_P (1 - k_D |P_1 - P_2|)."""
    return T_P - T_P * min(k_D * abs(P_1 - P_2), 1.0)


effect = Effect(
    name="pressure_dependent_displacement",
    place="flow",
    summary="the displacement falls in proportion to the pressure difference",
    fingerprint="flow error ~ omega |dP| and torque error ~ dP |dP|: no creep under load at standstill, unlike a leak",
    changes={"Q_P": flow, "T_P": torque},
    parameters=(
        EffectParameter("k_D", "1/Pa", "share of D that is lost per pascal", 0.0, 1e-8, 0.0, 1e-6, detectable=5e-9),
    ),
    source="form assumed: the same compliance in (2) and (3)",
)
