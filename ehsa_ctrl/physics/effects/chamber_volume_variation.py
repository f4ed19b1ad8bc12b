"""Chamber volumes other than believed: V_10, V_20 or V wrong, or a slope with the stroke that (6) leaves out.

The slope is in shares of the piston area: c_V = 1 adds A x to chamber 1 and takes it from chamber 2, which turns the
constant volumes of (6) into those of (11).
"""

from ._candidate import Candidate, Free, Rig, starts_of
from ._effect import Effect, EffectParameter


def volume_1(V_1: float, x: float, A: float, c_V: float) -> float:
    """V_1 + c_V A x."""
    return V_1 + c_V * (A * x)


def volume_2(V_2: float, x: float, A: float, c_V: float) -> float:
    """V_2 - c_V A x."""
    return V_2 - c_V * (A * x)


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """All volumes at once, and their slope with the stroke."""
    free = tuple(rig.symbol(symbol, 0.1) for symbol in effect.symbols if rig.shows(symbol))
    if not free:
        return []
    if rig.shows("c_V"):
        free = (*free, Free("c_V", rig.value("c_V"), 0.2, -1.0, 3.0))
    return [Candidate(free, starts_of(free, 0.0))]


effect = Effect(
    name="chamber_volume_variation",
    place="flow",
    summary="chamber volumes other than believed, constant or with the stroke",
    fingerprint="P_1 + P_2 moves with the rod, and the hydraulic mode with the position",
    changes={"V_1": volume_1, "V_2": volume_2},
    parameters=(EffectParameter("c_V", "1", "slope of the volumes, in piston areas", 0.0, 1.0, -1.0, 3.0),),
    symbols={"V_10": 0.0, "V_20": 0.0, "V": 0.0},
    candidates=candidates,
    source="paper, (11)",
)
