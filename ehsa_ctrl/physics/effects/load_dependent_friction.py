"""Seals, guides or gears that press harder under load: Coulomb friction grows by kappa times the force transmitted.

That force is the piston's, A (P_1 - P_2), or the torque of a gear.
"""

from ._candidate import CandidateEffect, DiagnosisContext, from_neutral
from ._effect import Effect, EffectParameter


def friction(F_FR: float, d_R: float, F_P: float, kappa: float) -> float:
    """F_FR + sign(v) kappa |F_P|, set-valued at standstill."""
    return F_FR + d_R * (kappa * abs(F_P))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Alone, and with the Coulomb level, which contains the part at rest if friction grows with the pressures."""
    coulomb = (context.plant_parameter("A_FR", 0.1),) if context.value("A_FR") > 0.0 else ()
    return from_neutral(effect, context, *coulomb)


effect = Effect(
    name="load_dependent_friction",
    place="force",
    summary="friction of rod or gear that grows with the load",
    fingerprint="friction level in the force balance rises with |dP|",
    changes={"F_FR": friction},
    parameters=(EffectParameter("kappa", "1", "friction per force", 0.0, 0.05, 0.0, 0.9, detectable=0.03),),
    candidates=candidates,
    source="Coulomb's law at a loaded guide",
)
