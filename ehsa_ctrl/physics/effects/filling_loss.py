"""Incomplete filling of the pump at high speed: the inlet throttles, and pump chambers close before they are full.

D (1 - k_f (omega / OMEGA_F)^2) replaces D in the flow (2) and in the torque (3): the pressure loss of the inlet grows
with the square of the speed, and a chamber without oil carries no pressure.
"""

from ._effect import Effect, EffectParameter

#: Speed at which the lost share is k_f [rad/s]: 4500 rpm, the largest speed of the pump.
OMEGA_F = 471.2


def flow(Q_P: float, omega: float, D: float, k_f: float) -> float:
    """Q_P - D omega k_f (omega / OMEGA_F)^2; the lost share is at most 1."""
    return Q_P - D * omega * min(k_f * (omega / OMEGA_F) * (omega / OMEGA_F), 1.0)


def torque(T_P: float, omega: float, k_f: float) -> float:
    """T_P (1 - k_f (omega / OMEGA_F)^2)."""
    return T_P - T_P * min(k_f * (omega / OMEGA_F) * (omega / OMEGA_F), 1.0)


effect = Effect(
    name="filling_loss",
    place="flow",
    summary="the displacement falls with the square of the speed",
    fingerprint="flow error ~ omega^3, independent of pressure: at low speed the displacement is nominal",
    changes={"Q_P": flow, "T_P": torque},
    parameters=(
        EffectParameter(
            "k_f", "1", "share of the displacement that is lost at 4500 rpm", 0.0, 0.05, 0.0, 1.0, detectable=0.01
        ),
    ),
    source="form assumed: losses of an inlet grow with the square of the flow",
)
