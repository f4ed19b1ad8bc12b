"""Presliding: before it slides, the rod gives elastically by some micrometres, the LuGre law instead of (8)."""

from ._candidate import Candidate, Free, Rig, starts_of
from ._effect import Effect

#: What a diagnosis calls 1 / sigma_0 [m/N], so that zero is a rod that does not yield, and the bristles' damping
#: [N s/m]; where that is not set it goes with their stiffness.
SOFTNESS, DAMPING = "softness_FR", "sigma_1_FR"
#: Bristles stiffer than this can't be told from none [m/N].
HARD = 1e-9


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Softness with and without damping. Bristles take the place of static friction, so that its excess is free too."""
    if not rig.yields() or rig.value("A_FR") + rig.value("C_FR") == 0.0:
        return []
    known = 1.0 / rig.value("sigma_0_FR") if rig.value("sigma_0_FR") else 0.0
    free = (Free(SOFTNESS, known, max(5e-8, 0.1 * known), 0.0, 5e-6), rig.symbol("C_FR", 0.3, 50.0))
    starts = starts_of(free, 0.0) if known else starts_of(free, 1.0, 6.0)
    damped = (*free, Free(DAMPING, 5e3, 2e3, 0.0, 1e5))
    return [Candidate(free, starts), Candidate(damped, tuple((*start, 5e3) for start in starts))]


effect = Effect(
    name="presliding",
    place="force",
    summary="elastic motion of the rod before it slides (LuGre)",
    fingerprint="loops of force over position at reversals; the resting rod moves in proportion to the force",
    rod_friction="lugre",
    candidates=candidates,
    source="Canudas de Wit et al. 1995, see physics/friction/lugre.py",
)
