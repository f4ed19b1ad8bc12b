"""Play between rod and load: the spring acts only beyond half of the play, on either side of its centre."""

from ._candidate import CandidateEffect, DiagnosisContext, from_neutral
from ._effect import Effect, EffectParameter


def deflection(s: float, width: float) -> float:
    """Deflection of the spring: |s| - width/2 beyond the play, zero within it."""
    half = 0.5 * width
    return max(s - half, 0.0) + min(s + half, 0.0) if width > 0.0 else s


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Play has no effect without a spring."""
    return from_neutral(effect, context) if context.value("K_S") != 0.0 else []


effect = Effect(
    name="backlash",
    place="force",
    summary="play between rod and load",
    fingerprint="the load cell reads nothing while the rod crosses the play",
    changes={"s": deflection},
    parameters=(EffectParameter("width", "m", "play", 0.0, 1e-3, 0.0, 0.1, detectable=2e-4),),
    candidates=candidates,
    source="dead zone in front of a spring without mass",
)
