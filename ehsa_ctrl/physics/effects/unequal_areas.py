"""Unequal piston areas: A (1 + dA/2) in chamber 1 and A (1 - dA/2) in chamber 2."""

from ._effect import Effect, EffectParameter


def force(F_P: float, P_1: float, P_2: float, A: float, dA: float) -> float:
    """A_1 P_1 - A_2 P_2."""
    return F_P + (0.5 * dA * A) * (P_1 + P_2)


def rate_1(P_1_dot: float, v: float, V_1: float, A: float, beta: float, dA: float) -> float:
    """Chamber 1 grows faster."""
    return P_1_dot - (0.5 * dA * A) * (beta * v / V_1)


def rate_2(P_2_dot: float, v: float, V_2: float, A: float, beta: float, dA: float) -> float:
    """Chamber 2 shrinks more slowly."""
    return P_2_dot - (0.5 * dA * A) * (beta * v / V_2)


effect = Effect(
    name="unequal_areas",
    place="flow",
    summary="the two piston areas differ",
    fingerprint="P_1 + P_2 falls in proportion to the position; force error proportional to P_1 + P_2",
    changes={"F_P": force, "P_1_dot": rate_1, "P_2_dot": rate_2},
    parameters=(EffectParameter("dA", "1", "(A_1 - A_2) / A", 0.0, 0.02, -0.3, 0.3, detectable=0.005),),
    source="continuity and force balance with two areas",
)
