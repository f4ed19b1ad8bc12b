"""Pressure drop in the lines: the pressures at the pump ports differ from those in the cylinder.

Each line has a laminar and a turbulent drop, R_lam Q + R_turb Q |Q| with Q = A v. P_1 and P_2 remain the pressures at
the ports, where the sensors and nearly all of the oil are; the drops reduce the force on the piston. The laminar part
acts exactly as additional viscous friction of the rod, 2 A^2 R_lam, the turbulent part as drag 2 A^3 R_turb v |v|.
"""

from collections.abc import Mapping
from math import inf

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber
from ._effect import Effect, EffectParameter


def force(F_P: float, v: float, A: float, R_lam: float, R_turb: float) -> float:
    """A (P_1 - P_2) less the drop of both lines."""
    flow = A * v
    return F_P - 2.0 * A * (flow * (R_lam + R_turb * abs(flow)))


#: Share of the turbulent part in the drop below which no log tells it from a laminar one. Engineering judgement.
LAMINAR = 0.1


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Both parts at once, from a turbulent drop."""
    lines = (
        FreeNumber("R_turb", context.value("R_turb"), 2e12, 0.0, inf),
        FreeNumber("R_lam", context.value("R_lam"), 2e8, 0.0, inf),
    )
    return [CandidateEffect(effect, lines, ((2e12, 0.0),))]


def equivalent_effects(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """A laminar drop acts as viscous friction of the rod, 2 A^2 R_lam; a turbulent one as drag, 2 A^3 R_turb v |v|."""
    laminar, turbulent = found.get("R_lam", 0.0), found.get("R_turb", 0.0) * plant["A"] * speed
    if turbulent >= LAMINAR * (laminar + turbulent):
        return {"rod_drag": "a turbulent drop between pump ports and chambers acts as drag of the rod ~ v |v|"}
    return {"rod_viscous_friction": "a laminar drop between pump ports and chambers acts as viscous friction"}


effect = Effect(
    name="line_pressure_drop",
    place="force",
    summary="pressure drop between pump ports and chambers",
    fingerprint="force error ~ v |v| (turbulent) or ~ v (laminar: the same as viscous rod friction)",
    changes={"F_P": force},
    parameters=(
        EffectParameter("R_turb", "Pa s2/m6", "turbulent, each line", 0.0, 2e12, 0.0),
        EffectParameter("R_lam", "Pa s/m3", "laminar, each line", 0.0, 0.0, 0.0),
    ),
    candidates=candidates,
    equivalent_effects=equivalent_effects,
    source="pipe flow, laminar and turbulent",
)
