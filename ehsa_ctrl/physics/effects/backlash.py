"""Play between rod and load: the spring acts only beyond half of the play, on either side of its centre."""

from ._candidate import CandidateEffect, DiagnosisContext, from_neutral
from ._effect import Effect, EffectParameter


def force(F_EXT: float, x: float, K_S: float, k_3: float, width: float) -> float:
    """The spring's force at the position less the play, x - width/2 beyond it and zero within."""
    half = 0.5 * width
    felt = max(x - half, 0.0) + min(x + half, 0.0)
    there = x * (K_S + k_3 * x * x)
    return F_EXT + (felt * (K_S + k_3 * felt * felt) - there if width > 0.0 else 0.0)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Play has no effect without a spring."""
    return from_neutral(effect, context) if context.value("K_S") != 0.0 else []


effect = Effect(
    name="backlash",
    place="force",
    summary="play between rod and load",
    fingerprint="the load cell reads nothing while the rod crosses the play",
    changes={"F_EXT": force},
    parameters=(EffectParameter("width", "m", "play", 0.0, 1e-3, 0.0, 0.1, felt=2e-4),),
    candidates=candidates,
    source="dead zone in front of a spring without mass",
)
