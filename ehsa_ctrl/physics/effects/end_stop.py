"""End stops of the cylinder: stiff, damped contact beyond +-x_stop that pushes but never pulls.

The contact is inside the cylinder, so a load cell between rod and load does not measure it.

A cushion before the stop throttles the oil that leaves, in a gap that narrows with the depth d beyond +-x_cushion: a
force d (K + B v + C v^2) against motion towards the end. B stands for laminar flow through a gap, C for turbulent flow
through an orifice, K for the elasticity of oil and seal, which pushes back. That all grow with the depth is assumed.
"""

from dataclasses import replace
from math import inf

import numpy as np

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number, from_levels, measured
from ._effect import Effect, EffectParameter

#: A typical cushion: 1 kN, about the rod's friction, at a depth of 10 mm by its elasticity, and as much by its gap at
#: 10 mm/s. Engineering judgement.
STIFFNESS, GAP = 1e5, 1e7


def net_force(
    F_net: float,
    x: float,
    v: float,
    x_stop: float,
    K_stop: float,
    B_stop: float,
    x_cushion: float,
    B_cushion: float,
    K_cushion: float,
    C_cushion: float,
) -> float:
    """F_net less contact and cushion. The damping of the contact grows over the first 0.1 mm, to keep it continuous."""
    into_front = max(x - x_stop, 0.0)
    into_back = max(-x - x_stop, 0.0)
    front = max(K_stop * into_front + B_stop * min(into_front / 1e-4, 1.0) * v, 0.0)
    back = max(K_stop * into_back - B_stop * min(into_back / 1e-4, 1.0) * v, 0.0)
    out = max(v, 0.0)
    back_in = max(-v, 0.0)
    outward = max(x - x_cushion, 0.0) * (K_cushion + (B_cushion + C_cushion * out) * out)
    inward = max(-x - x_cushion, 0.0) * (K_cushion + (B_cushion + C_cushion * back_in) * back_in)
    return F_net - (front - back) - (outward - inward)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A stop near the largest position that the rod reached; a cushion below it."""
    positions = measured(context, "x")
    if not positions:
        return []
    reach = float(np.max(np.abs(positions[0])))
    stop = replace(effect_number(effect, context, "x_stop", 0.02 * reach), lower=1e-3)
    cushion = replace(effect_number(effect, context, "x_cushion", 0.05 * reach), lower=1e-3)
    forces = (
        FreeNumber("B_cushion", GAP, 0.1 * GAP, 0.0),
        FreeNumber("K_cushion", STIFFNESS, 0.3 * STIFFNESS, 0.0),
        FreeNumber("C_cushion", 0.0, GAP, 0.0),
    )
    return [
        from_levels(effect, stop, [share * reach for share in (1.002, 0.985, 0.9)]),
        from_levels(effect, cushion, [share * reach for share in (0.85, 0.65)], *forces),
    ]


effect = Effect(
    name="end_stop",
    place="force",
    summary="contact with the cylinder's ends",
    fingerprint="the rod stops abruptly at one position while the pressure still rises",
    changes={"F_net": net_force},
    parameters=(
        EffectParameter("x_stop", "m", "half of the free stroke", inf, 0.1, 1e-3, source="datasheet"),
        EffectParameter("K_stop", "N/m", "contact stiffness", 1e8, 1e8, 0.0),
        EffectParameter("B_stop", "N s/m", "contact damping", 1e5, 1e5, 0.0),
        EffectParameter("x_cushion", "m", "position at which the cushion begins", inf, inf, 1e-3),
        EffectParameter("B_cushion", "N s/m2", "its force per depth and speed", GAP, GAP, 0.0),
        EffectParameter("K_cushion", "N/m", "its force per depth", 0.0, 0.0, 0.0),
        EffectParameter("C_cushion", "N s2/m3", "its force per depth and speed squared", 0.0, 0.0, 0.0),
    ),
    candidates=candidates,
)
