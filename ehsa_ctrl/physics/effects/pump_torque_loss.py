"""Load-dependent friction of the pump: a share c of its pressure torque, against the motion.

T_L = c D |P_1 - P_2| sign(omega), c = c_f (1 + b_f / (1 + |omega| / w_f)) + c_w |omega|. The first term is the
pressure-dependent part of the loss model of W. M. J. McCandlish, R. E. Dorey (Proc. IMechE 198B, 1984). b_f raises it
at low speed, where the oil film does not carry; the form is assumed. c_w is the part that grows with the speed, as for
gaps that the pressure presses together. Set-valued at standstill, like all dry friction.
"""

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number, from_neutral, starting_points
from ._effect import Effect, EffectParameter


def loss_share(omega: float, c_f: float, b_f: float, w_f: float, c_w: float) -> float:
    """c, never negative."""
    speed = abs(omega)
    return c_f * (1.0 + b_f * (w_f / (w_f + speed))) + c_w * speed


def friction(
    T_FM: float, d_M: float, omega: float, P_1: float, P_2: float, D: float,
    c_f: float, b_f: float, w_f: float, c_w: float,
) -> float:  # fmt: skip
    """T_FM + sign(omega) c |D (P_1 - P_2)|."""
    return T_FM + d_M * (loss_share(omega, c_f, b_f, w_f, c_w) * abs(D * (P_1 - P_2)))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A constant share, one that is twice as large at low speed, and one that grows with the speed."""
    film = (
        effect_number(effect, context, "c_f", 0.03),
        FreeNumber("b_f", 1.0, 0.3, 0.0, 5.0),
        FreeNumber("w_f", 40.0, 15.0, 5.0, 200.0),
    )
    growing = (effect_number(effect, context, "c_w", 1e-4),)
    return [
        *from_neutral(effect, context),
        CandidateEffect(effect, film, ((0.05, 1.0, 40.0),)),
        CandidateEffect(effect, growing, starting_points(growing, 1.0, 8.0)),
    ]


effect = Effect(
    name="pump_torque_loss",
    place="torque",
    summary="pump friction that grows with the pressure difference",
    fingerprint="torque error ~ |dP| sign(omega): driving and braking differ by twice its size",
    changes={"T_FM": friction},
    parameters=(
        EffectParameter("c_f", "1", "share of D |dP| that is lost", 0.0, 0.1, 0.0, 0.5, detectable=0.03),
        EffectParameter("b_f", "1", "further share at low speed, in c_f", 0.0, 0.0, 0.0, 20.0, shape=True),
        EffectParameter("w_f", "rad/s", "speed at which half of that share is left", 40.0, 40.0, 1.0, 1e3, shape=True),
        EffectParameter("c_w", "s/rad", "share per speed", 0.0, 0.0, 0.0, 1e-2),
    ),
    candidates=candidates,
    source="McCandlish and Dorey 1984, pressure-dependent term",
)
