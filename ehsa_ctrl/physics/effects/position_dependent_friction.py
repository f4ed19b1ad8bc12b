"""A tight spot: Coulomb friction of the rod is higher around one position."""

from math import exp

import numpy as np

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number, measured
from ._effect import Effect, EffectParameter


def friction(F_FR: float, d_R: float, x: float, A_FR: float, h_FR: float, x_h: float, w_h: float) -> float:
    """F_FR + sign(v) A_FR h exp(-((x - x_h) / w_h)^2)."""
    s = (x - x_h) / w_h
    return F_FR + d_R * (A_FR * h_FR * exp(-s * s))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A bump at one of five positions within the range of motion."""
    positions = measured(context, "x")
    if not positions or context.value("A_FR") == 0.0:
        return []
    low, high = np.quantile(positions[0], [0.02, 0.98])
    width = float(np.clip(0.2 * (high - low), 3e-3, 0.015))
    bump = (
        effect_number(effect, context, "h_FR", 0.15),
        FreeNumber("x_h", 0.0, 0.3 * width, -1.0, 1.0),
        FreeNumber("w_h", width, 0.2 * width, 2e-3, 0.04),
    )
    return [CandidateEffect(effect, bump, tuple((0.3, float(at), width) for at in np.linspace(low, high, 7)[1:-1]))]


effect = Effect(
    name="position_dependent_friction",
    place="force",
    summary="rod friction is higher around one position: a tight spot",
    fingerprint="a bump of dP at the same position in both directions, with the sign of the speed",
    changes={"F_FR": friction},
    parameters=(
        EffectParameter("h_FR", "1", "height of the bump, in A_FR", 0.0, 0.5, -0.95, 10.0),
        EffectParameter("x_h", "m", "its position", 0.0, 0.0, -1.0, 1.0, shape=True),
        EffectParameter("w_h", "m", "its width", 0.015, 0.015, 1e-3, 1.0, shape=True),
    ),
    candidates=candidates,
    source="form assumed",
)
