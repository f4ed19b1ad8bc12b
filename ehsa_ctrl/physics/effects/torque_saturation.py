"""Magnetic saturation: at high current the torque is less than K_T I.

T_M = K_T I / (1 + (k_sat I)^2), 3 % less at k_sat I = 0.17. The form is assumed: smooth, odd in I, with a torque
constant that falls monotonically. Data sheets (Kollmorgen AKM) only state that torque is proportional up to about twice
the continuous current. A hard knee is the other extreme: beyond I_knee the torque rises with s_knee K_T, or not at all
if the drive limits the current.
"""

from math import inf

import numpy as np

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number, from_levels, from_neutral
from ._effect import Effect, EffectParameter


def torque(T_M: float, current: float, K_T: float, k_sat: float, I_knee: float, s_knee: float) -> float:
    """What the knee leaves of T_M, over 1 + (k_sat I)^2."""
    beyond = max(current - I_knee, 0.0) - max(-current - I_knee, 0.0)
    return (T_M - (1.0 - s_knee) * K_T * beyond) / (1.0 + (k_sat * current) * (k_sat * current))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Smooth; and a knee below the highest current."""
    top = float(np.quantile(np.abs(context.log[context.drive]), 0.998))
    knee = effect_number(effect, context, "I_knee", 0.05 * top)
    slope = FreeNumber("s_knee", 0.3, 0.1, 0.0, 1.0)
    levels = [share * top for share in (0.85, 0.65, 0.45)] if top > 0.0 else []
    return [*from_neutral(effect, context), *([from_levels(effect, knee, levels, slope)] if levels else [])]


effect = Effect(
    name="torque_saturation",
    place="torque",
    summary="the torque constant falls with the current",
    fingerprint="torque error only at high current, odd in the current",
    changes={"T_M": torque},
    parameters=(
        EffectParameter("k_sat", "1/A", "T_M = K_T I / (1 + (k_sat I)^2)", 0.0, 0.1, 0.0, 1.0, detectable=0.05),
        EffectParameter("I_knee", "A", "current from which the torque rises less", inf, inf, 0.0),
        EffectParameter("s_knee", "1", "slope beyond the knee, in K_T", 0.3, 0.3, 0.0, 1.0),
    ),
    candidates=candidates,
    source="forms assumed; data sheets give the limit of proportionality",
)
