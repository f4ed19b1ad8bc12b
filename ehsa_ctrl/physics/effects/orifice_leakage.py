"""Turbulent leakage between the chambers, e.g. at a scratched piston seal.

Q = K_t dP / (dP^2 + P_tr^2)^(1/4), which is K_t sqrt|dP| sign(dP) well above the transition pressure P_tr and linear
below it, so that its slope stays finite.
"""

from math import sqrt

from ._effect import Effect, EffectParameter

#: Transition pressure [Pa]. Engineering judgement: small against the pressures of a log.
P_TR = 1e4


def flow(Q_P: float, P_1: float, P_2: float, K_t: float) -> float:
    """Q_P less the leakage from chamber 1 to chamber 2."""
    drop = P_1 - P_2
    return Q_P - K_t * (drop / sqrt(sqrt(drop * drop + P_TR * P_TR)))


effect = Effect(
    name="orifice_leakage",
    place="flow",
    summary="leakage between the chambers that grows with the root of the pressure difference",
    fingerprint="flow error concave in dP, while that of laminar leakage is linear",
    changes={"Q_P": flow},
    parameters=(EffectParameter("K_t", "m3/(s Pa^0.5)", "Q = K_t sqrt(dP)", 0.0, 3e-9, 0.0, detectable=1e-9),),
    source="orifice law, regularised at zero",
)
