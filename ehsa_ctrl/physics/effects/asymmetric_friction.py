"""Rod friction that depends on the direction: A_FR (1 + a sign v)."""

from ._effect import Effect, EffectParameter


def friction(F_FR: float, d_R: float, A_FR: float, a_FR: float) -> float:
    """F_FR + a A_FR while sliding: more when extending, less when retracting."""
    return F_FR + d_R * (a_FR * A_FR) * d_R


effect = Effect(
    name="asymmetric_friction",
    place="force",
    summary="rod friction differs between extending and retracting",
    fingerprint="friction levels differ by direction, and the rod drifts under a symmetric input",
    changes={"F_FR": friction},
    parameters=(EffectParameter("a_FR", "1", "A_FR (1 + a sign v)", 0.0, 0.1, -0.9, 0.9),),
    source="definition",
)
