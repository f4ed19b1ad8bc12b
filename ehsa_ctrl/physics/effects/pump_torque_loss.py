"""Load-dependent friction of the pump: a share c_f of its pressure torque, against the motion.

T_L = c_f D |P_1 - P_2| sign(omega), the pressure-dependent part of the loss model of W. M. J. McCandlish, R. E. Dorey
(Proc. IMechE 198B, 1984). Set-valued at standstill, like all dry friction.
"""

from ._effect import Effect, EffectParameter


def friction(T_FM: float, d_M: float, P_1: float, P_2: float, D: float, c_f: float) -> float:
    """T_FM + sign(omega) c_f |D (P_1 - P_2)|."""
    return T_FM + d_M * (c_f * abs(D * (P_1 - P_2)))


effect = Effect(
    name="pump_torque_loss",
    place="torque",
    summary="pump friction that grows with the pressure difference",
    fingerprint="torque error ~ |dP| sign(omega): driving and braking differ by twice its size",
    changes={"T_FM": friction},
    parameters=(EffectParameter("c_f", "1", "share of D |dP| that is lost", 0.0, 0.1, 0.0, 0.5, detectable=0.03),),
    source="McCandlish and Dorey 1984, pressure-dependent term",
)
