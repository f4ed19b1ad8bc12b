"""Drag on the rod that grows with the square of its speed: k_v v |v|, of air or of oil in a throttle at the load."""

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, starting_points
from ._effect import Effect, EffectParameter


def net_force(F_net: float, v: float, k_v: float) -> float:
    """F_net - k_v v |v|, zero at standstill."""
    return F_net - k_v * v * abs(v)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """None for a plant with lines: no log distinguishes it from their turbulent drop, which stands for both."""
    if context.simulated("R_turb"):
        return []
    free = (FreeNumber("k_v", context.value("k_v"), 2e3 * context.effort, 0.0),)
    return [CandidateEffect(effect, free, starting_points(free, 1.0, 8.0))]


effect = Effect(
    name="rod_drag",
    place="force",
    summary="drag on the rod that grows with the square of its speed",
    fingerprint="force error ~ v |v|: the same as a turbulent pressure drop in the lines",
    changes={"F_net": net_force},
    parameters=(EffectParameter("k_v", "N s2/m2", "force k_v v |v|", 0.0, 1.5e4, 0.0, detectable=2e3),),
    candidates=candidates,
    source="turbulent drag, as in textbooks of fluid mechanics",
)
