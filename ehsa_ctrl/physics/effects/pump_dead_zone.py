"""A pump that delivers nothing at the lowest speeds, because of leakage that does not depend on the pressure.

Without other leakage, Q_P = D sign(omega) max(|omega| - w_d, 0). The leakage term Q_L sign(omega) of some pump models
is the same with w_d = Q_L / D.
"""

from ._effect import Effect, EffectParameter


def flow(Q_P: float, omega: float, D: float, w_d: float) -> float:
    """Q_P less the flow of an ideal pump within the zone."""
    return Q_P - D * min(max(omega, -w_d), w_d)


effect = Effect(
    name="pump_dead_zone",
    place="flow",
    summary="no flow for speeds within a dead zone, and less by the zone beyond",
    fingerprint="flow error of constant size with the sign of omega: lost motion at each reversal",
    changes={"Q_P": flow},
    parameters=(EffectParameter("w_d", "rad/s", "half the width of the zone", 0.0, 5.0, 0.0, 100.0, detectable=0.5),),
    source="dead zone, as in textbooks of control",
)
