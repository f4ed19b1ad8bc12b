"""A tight spot: Coulomb friction of the rod is higher around one position.

Two nested forms: a second spot, and spots that repeat along the stroke, n_h of them per metre, as on a bore with waves.
"""

from itertools import combinations
from math import exp, pi, sin

import numpy as np

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number, measured
from ._effect import Effect, EffectParameter

#: Range of motion [m] from which on two spots and repeated ones are tried. Engineering judgement: seals and guides are
#: several millimetres long and average over what is finer.
REACH = 0.01
#: Numbers of repeated spots within the range of motion that are tried; the search reaches half of their spacing.
NUMBERS = np.arange(2.0, 8.1, 0.75)


def spot(x: float, x_h: float, w_h: float, n_h: float) -> float:
    """exp(-(distance / w_h)^2); the distance becomes sin(pi n_h distance) / (pi n_h) where spots repeat."""
    away = x - x_h
    repeated = sin(pi * n_h * away) / (pi * max(n_h, 1e-3))
    s = (repeated if n_h > 0.0 else away) / w_h
    return exp(-s * s)


def friction(
    F_FR: float, d_R: float, x: float, A_FR: float,
    h_FR: float, x_h: float, w_h: float, n_h: float, h_FR2: float, x_h2: float,
) -> float:  # fmt: skip
    """F_FR + sign(v) A_FR (h spot(x - x_h) + h_2 spot(x - x_h2))."""
    second = h_FR2 * spot(x, x_h2, w_h, n_h) if h_FR2 != 0.0 else 0.0
    return F_FR + d_R * (A_FR * (h_FR * spot(x, x_h, w_h, n_h) + second))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A spot at one of five positions within the range of motion; two of them; spots that repeat 2 to 8 times in it.

    No gradient leads to the number of spots or to their places, so each is a start.
    """
    positions = measured(context, "x")
    if not positions or context.value("A_FR") == 0.0:
        return []
    low, high = (float(edge) for edge in np.quantile(positions[0], [0.02, 0.98]))
    width = float(np.clip(0.2 * (high - low), 3e-3, 0.015))
    height = effect_number(effect, context, "h_FR", 0.15)
    place, size = FreeNumber("x_h", 0.0, 0.3 * width, -1.0, 1.0), FreeNumber("w_h", width, 0.2 * width, 1e-3, 0.04)
    places = [float(at) for at in np.linspace(low, high, 7)[1:-1]]
    found = [CandidateEffect(effect, (height, place, size), tuple((0.3, at, width) for at in places))]
    if high - low < REACH:
        return found
    second = (FreeNumber("h_FR2", 0.0, 0.15, -0.95, 10.0), FreeNumber("x_h2", 0.0, 0.3 * width, -1.0, 1.0))
    pairs = tuple((0.3, a, 0.6 * width, 0.3, b) for a, b in combinations(places, 2))
    found.append(CandidateEffect(effect, (height, place, size, *second), pairs))
    starts = []
    for number in NUMBERS / (high - low):
        # Half of a raised cosine is as wide as a spot exp(-s^2) with this width.
        spot_width = 0.25 / float(number)
        starts += [(0.3, at / float(number), spot_width, float(number)) for at in (0.0, 0.25)]
    number = FreeNumber("n_h", 0.0, 0.1 / (high - low), 0.0, 1e3)
    found.append(CandidateEffect(effect, (height, place, size, number), tuple(starts)))
    return found


effect = Effect(
    name="position_dependent_friction",
    place="force",
    summary="rod friction is higher around one position: a tight spot",
    fingerprint="a bump of dP at the same position in both directions, with the sign of the speed",
    changes={"F_FR": friction},
    parameters=(
        EffectParameter("h_FR", "1", "height of the bump, in A_FR", 0.0, 0.5, -0.95, 10.0),
        EffectParameter("x_h", "m", "its position", 0.0, 0.0, -1.0, 1.0, shape=True),
        EffectParameter("w_h", "m", "its width", 0.015, 0.015, 1e-3, 1.0, shape=True),
        EffectParameter("n_h", "1/m", "number of spots per length; zero: one spot", 0.0, 0.0, 0.0, 1e3, shape=True),
        EffectParameter("h_FR2", "1", "height of a second spot, in A_FR", 0.0, 0.0, -0.95, 10.0, shape=True),
        EffectParameter("x_h2", "m", "its position", 0.0, 0.0, -1.0, 1.0, shape=True),
    ),
    candidates=candidates,
    source="form assumed",
)
