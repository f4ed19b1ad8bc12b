"""Incomplete filling at high speed: the inlet throttles, and the chambers close before they are full.

D (1 - k_f (omega / OMEGA_F)^2) in place of D, in the flow (2) and in the torque (3): the pressure loss of the inlet
grows with the square of the speed, and a chamber without oil carries no pressure either.
"""

from ._effect import Effect, EffectParameter

#: Speed at which the share that is lost is k_f: the pump's greatest, 4500 rpm [rad/s].
OMEGA_F = 471.2


def flow(Q_P: float, omega: float, D: float, k_f: float) -> float:
    """Q_P - D omega k_f (omega / OMEGA_F)^2; no more than all of it is lost."""
    return Q_P - D * omega * min(k_f * (omega / OMEGA_F) * (omega / OMEGA_F), 1.0)


def torque(T_P: float, omega: float, k_f: float) -> float:
    """T_P (1 - k_f (omega / OMEGA_F)^2)."""
    return T_P - T_P * min(k_f * (omega / OMEGA_F) * (omega / OMEGA_F), 1.0)


effect = Effect(
    name="filling_loss",
    place="flow",
    summary="the pump delivers less at high speed, with the square of it",
    fingerprint="flow error ~ omega^3, whatever the pressure: at low speed the displacement is right",
    changes={"Q_P": flow, "T_P": torque},
    parameters=(
        EffectParameter(
            "k_f", "1", "share of the displacement that is lost at 4500 rpm", 0.0, 0.05, 0.0, 1.0, felt=0.01
        ),
    ),
    source="form assumed: losses of an inlet go with the square of the flow",
)
