"""Rod friction that depends on the direction: A_FR (1 + a sign v), and B_FR (1 + b sign v) for the viscous part."""

from collections.abc import Mapping

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, from_neutral
from ._effect import Effect, EffectParameter


def friction(F_FR: float, d_R: float, v: float, A_FR: float, B_FR: float, a_FR: float, b_FR: float) -> float:
    """F_FR + a A_FR + b B_FR |v| while sliding: more when extending, less when retracting."""
    return F_FR + d_R * (a_FR * A_FR) * d_R + b_FR * B_FR * (v * d_R)


def level_is_offset(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """A constant while the rod slides; only the viscous part, and a rod that sticks under load, tell them apart."""
    return {"constant_force": "while the rod slides, a level that differs by direction is a constant force"}


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """The Coulomb part alone, and together with the viscous part."""
    return from_neutral(effect, context, FreeNumber("b_FR", context.value("b_FR"), 0.03, -0.9, 0.9))


effect = Effect(
    name="asymmetric_friction",
    place="force",
    summary="rod friction differs between extending and retracting",
    fingerprint="friction levels differ by direction, and the rod drifts under a symmetric input",
    changes={"F_FR": friction},
    parameters=(
        EffectParameter("a_FR", "1", "A_FR (1 + a sign v)", 0.0, 0.1, -0.9, 0.9, detectable=0.03),
        EffectParameter("b_FR", "1", "B_FR (1 + b sign v)", 0.0, 0.0, -0.9, 0.9),
    ),
    candidates=candidates,
    equivalent_effects=level_is_offset,
    source="definition",
)
