"""Chamber volumes that differ from nominal: V_10, V_20 or V, or the slope with the stroke that (6) neglects.

The slope is relative to the piston area: c_V = 1 adds A x to chamber 1 and subtracts it from chamber 2, which turns the
constant volumes of (6) into those of (11).
"""

from collections.abc import Mapping

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, starting_points
from ._effect import Effect, EffectParameter

#: Volumes that differ by less than this share from one factor on all of them, also where the rod moves by this stroke
#: [m] to either side, act as that factor on the bulk modulus. Engineering judgement.
ALIKE, STROKE = 0.05, 0.05


def volume_1(V_1: float, x: float, A: float, c_V: float) -> float:
    """V_1 + c_V A x."""
    return V_1 + c_V * (A * x)


def volume_2(V_2: float, x: float, A: float, c_V: float) -> float:
    """V_2 - c_V A x."""
    return V_2 - c_V * (A * x)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """All volumes at once, and their slope with the stroke."""
    free = tuple(context.plant_parameter(symbol, 0.1) for symbol in effect.symbols if context.simulated(symbol))
    if not free:
        return []
    if context.simulated("c_V"):
        free = (*free, FreeNumber("c_V", context.value("c_V"), 0.2, -1.0, 3.0))
    return [CandidateEffect(effect, free, starting_points(free, 0.0))]


def equivalent_effects(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """A factor on all volumes is one on the bulk modulus: (4) has V / beta."""
    names = [name for name in ("V_10", "V_20", "V") if name in found and plant.get(name)]
    if not names:
        return {}
    factors = [found[name] / plant[name] for name in names]
    # Volumes of (11) have the slope A, which the factor multiplies too; that of a linear model is constant.
    slope = found.get("c_V", 0.0) - (0.0 if names == ["V"] else min(factors) - 1.0)
    swept = max(abs(slope) * plant["A"] * STROKE / (plant[name] * min(factors)) for name in names)
    if max(factors) > (1.0 + ALIKE) * min(factors) or swept > ALIKE:
        return {}
    return {"bulk_modulus": "all volumes change alike, and pressures and flows show volume over bulk modulus"}


effect = Effect(
    name="chamber_volume_variation",
    place="flow",
    summary="chamber volumes differ from nominal, by a constant or with the stroke",
    fingerprint="P_1 + P_2 changes with the rod's motion, and the hydraulic mode with its position",
    changes={"V_1": volume_1, "V_2": volume_2},
    parameters=(EffectParameter("c_V", "1", "slope of the volumes, in piston areas", 0.0, 1.0, -1.0, 3.0),),
    symbols={"V_10": 0.0, "V_20": 0.0, "V": 0.0},
    candidates=candidates,
    equivalent_effects=equivalent_effects,
    source="paper, (4), (11)",
)
