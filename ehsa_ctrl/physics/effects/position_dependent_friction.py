"""A tight spot: Coulomb friction of the rod is higher around one position."""

from math import exp

from ._effect import Effect, EffectParameter


def friction(F_FR: float, d_R: float, x: float, A_FR: float, h_FR: float, x_h: float, w_h: float) -> float:
    """F_FR + sign(v) A_FR h exp(-((x - x_h) / w_h)^2)."""
    s = (x - x_h) / w_h
    return F_FR + d_R * (A_FR * h_FR * exp(-s * s))


effect = Effect(
    name="position_dependent_friction",
    place="force",
    summary="rod friction is higher around one position",
    fingerprint="a bump of dP at the same position in both directions, with the sign of the speed",
    changes={"F_FR": friction},
    parameters=(
        EffectParameter("h_FR", "1", "height of the bump, in A_FR", 0.0, 0.5, -0.95, 10.0),
        EffectParameter("x_h", "m", "its position", 0.0, 0.0, -1.0, 1.0),
        EffectParameter("w_h", "m", "its width", 0.015, 0.015, 1e-3, 1.0),
    ),
    source="form assumed",
)
