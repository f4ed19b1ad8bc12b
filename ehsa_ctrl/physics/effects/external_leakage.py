"""Laminar leakage from each chamber to the tank (gauge pressure zero)."""

from ._effect import Effect, EffectParameter


def flow_1(Q_T1: float, P_1: float, K_e: float) -> float:
    """Chamber 1 loses K_e P_1."""
    return Q_T1 - K_e * P_1


def flow_2(Q_T2: float, P_2: float, K_e: float) -> float:
    """Chamber 2 loses K_e P_2."""
    return Q_T2 - K_e * P_2


effect = Effect(
    name="external_leakage",
    place="flow",
    summary="leakage from the chambers to the tank",
    fingerprint="P_1 + P_2 decays with the time constant V / (beta K_e), with little effect on speed and position",
    changes={"Q_T1": flow_1, "Q_T2": flow_2},
    parameters=(EffectParameter("K_e", "m3/(s Pa)", "of each chamber", 0.0, 1e-13, 0.0, detectable=3e-14),),
    source="laminar gap",
)
