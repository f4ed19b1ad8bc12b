"""Presliding: before it slides, the rod yields elastically by some micrometres; the LuGre law replaces (8).

Or elastic sliders that slip one after the other, see `maxwell_slip`. A hypothesis estimates the compliance, for LuGre
1 / sigma_0 [m/N], so that zero is a rod without presliding.
"""

from collections.abc import Mapping
from math import sqrt

from .. import load
from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, starting_points
from ._effect import Effect, LawSwitch
from .maxwell_slip import NEGLIGIBLE_COMPLIANCE, sliders

COMPLIANCE, DAMPING = "softness_FR", "sigma_1_FR"


def critical_damping(compliance: float, plant: Mapping[str, float]) -> float:
    """sqrt(M sigma_0) [N s/m]: half the critical damping of the rod's mass on its bristles."""
    return sqrt(plant["M"] / compliance)


def deflection(
    P_1: float, P_2: float, x: float, A: float, K_S: float, x_C: float, x_R: float, A_FR: float, C_FR: float
) -> float:
    """Force on the bristles of a rod at rest [N], at most breakaway friction; z is this force times the compliance."""
    breakaway = A_FR + C_FR
    return min(max(A * (P_1 - P_2) - K_S * load.deflection(x, x_C, x_R), -breakaway), breakaway)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Compliance with and without damping, and that of Maxwell sliders.

    C_FR is free too, because the bristles take over part of static friction.
    """
    if not context.switches_law or context.value("A_FR") + context.value("C_FR") == 0.0:
        return []
    stiffness = context.value("sigma_0_FR")
    known = 1.0 / stiffness if stiffness else 0.0
    compliance = FreeNumber(COMPLIANCE, known, max(5e-8, 0.1 * known), 0.0, 5e-6)
    free = (compliance, context.plant_parameter("C_FR", 0.3, 50.0))
    starts = starting_points(free, 0.0) if known else starting_points(free, 1.0, 6.0)
    damped = (*free, FreeNumber(DAMPING, 5e3, 2e3, 0.0, 1e5))
    found = [
        CandidateEffect(effect, free, starts),
        CandidateEffect(effect, damped, tuple((*start, 5e3) for start in starts)),
    ]
    slip = sliders(context)
    if slip is not None and not known:
        elastic = (slip, free[1])
        found.append(CandidateEffect(effect, elastic, starting_points(elastic, 1.0, 4.0)))
    return found


effect = Effect(
    name="presliding",
    place="force",
    summary="elastic motion of the rod before it slides (LuGre)",
    fingerprint="hysteresis of force over position at reversals; at rest, the rod moves in proportion to the force",
    rod_friction="lugre",
    switch=LawSwitch(
        law="lugre",
        number=COMPLIANCE,
        parameter="sigma_0_FR",
        reported="sigma_0",
        threshold=NEGLIGIBLE_COMPLIANCE,
        defaults={DAMPING: critical_damping},
        state="z_R",
        deflection=deflection,
    ),
    candidates=candidates,
    source="Canudas de Wit et al. 1995, see physics/friction/lugre.py",
)
