"""A tight spot: Coulomb friction of the rod is higher around one position.

Three nested forms: a second spot; a bore with waves, n_h of them per metre; and a free profile over the range of motion
from x_a to x_b, the exponential of six terms of a cosine series. So it resists the motion whatever its coefficients
are, and A_FR is its geometric mean over the range. It stays constant beyond the range, with a continuous slope.
"""

from dataclasses import replace
from itertools import combinations
from math import cos, exp, pi

import numpy as np

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number, measured, starting_points
from ._effect import Effect, EffectParameter

#: Range of motion [m] from which on two spots and waves are tried. Engineering judgement: seals and guides are
#: several millimetres long and average over what is finer.
REACH = 0.01
#: Numbers of waves within the range of motion that are tried.
NUMBERS = np.arange(2.0, 8.1, 0.75)
#: Coefficients of a free profile: six leave 8 % of the spread of a spline through six random heights, five 11 %.
COEFFICIENTS = tuple(f"c_FR{k}" for k in range(1, 7))
#: Largest coefficient that a diagnosis tries. Engineering judgement: one alone varies friction by a factor of seven.
LARGEST = 1.0
#: Least friction at any place, in A_FR, so that it always resists the motion: two spots together or waves could push.
LEAST = 0.05


def profile(x: float, x_h: float, w_h: float, n_h: float) -> float:
    """exp(-((x - x_h) / w_h)^2), or cos(2 pi n_h (x - x_h)), which has a mean of zero: no level can pose as a wave."""
    s = (x - x_h) / w_h
    return cos(2.0 * pi * n_h * (x - x_h)) if n_h > 0.0 else exp(-s * s)


def series(
    x: float, x_a: float, x_b: float,
    c_FR1: float, c_FR2: float, c_FR3: float, c_FR4: float, c_FR5: float, c_FR6: float,
) -> float:  # fmt: skip
    """Sum of c_k cos(k pi s) with s = (x - x_a) / (x_b - x_a) within 0 to 1.

    Clenshaw's recurrence for Chebyshev polynomials of cos(pi s), because cos(k a) = T_k(cos a).
    """
    s = min(max((x - x_a) / max(x_b - x_a, 1e-9), 0.0), 1.0)
    u = cos(pi * s)
    b_5 = c_FR5 + 2.0 * u * c_FR6
    b_4 = c_FR4 + 2.0 * u * b_5 - c_FR6
    b_3 = c_FR3 + 2.0 * u * b_4 - b_5
    b_2 = c_FR2 + 2.0 * u * b_3 - b_4
    return u * (c_FR1 + 2.0 * u * b_2 - b_3) - b_2


def friction(
    F_FR: float, d_R: float, x: float, A_FR: float,
    h_FR: float, x_h: float, w_h: float, n_h: float, h_FR2: float, x_h2: float, x_a: float, x_b: float,
    c_FR1: float, c_FR2: float, c_FR3: float, c_FR4: float, c_FR5: float, c_FR6: float,
) -> float:  # fmt: skip
    """F_FR + sign(v) A_FR (h profile(x - x_h) + h_2 profile(x - x_h2) + exp(series(x)) - 1), at least LEAST A_FR."""
    second = h_FR2 * profile(x, x_h2, w_h, n_h) if h_FR2 != 0.0 else 0.0
    largest = max(abs(c_FR1), abs(c_FR2), abs(c_FR3), abs(c_FR4), abs(c_FR5), abs(c_FR6))
    free = exp(series(x, x_a, x_b, c_FR1, c_FR2, c_FR3, c_FR4, c_FR5, c_FR6)) - 1.0 if largest > 0.0 else 0.0
    return F_FR + d_R * (A_FR * max(h_FR * profile(x, x_h, w_h, n_h) + second + free, LEAST - 1.0))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A spot at one of five positions within the range of motion; two of them; 2 to 8 waves in it; a free profile.

    No gradient leads to the number of spots or to their places, so each is a start. A free profile starts at zero.
    """
    positions = measured(context, context.own_name("x"))
    if not positions or context.value("A_FR") == 0.0:
        return []
    low, high = (float(edge) for edge in np.quantile(positions[0], [0.02, 0.98]))
    # In metres for a rod, in radians for a gear.
    width = float(np.clip(0.2 * (high - low), 3e-3, max(0.015, 0.1 * (high - low))))
    height = effect_number(effect, context, "h_FR", 0.15)
    place = FreeNumber("x_h", 0.0, 0.3 * width, 2.0 * low - high, 2.0 * high - low)
    size = FreeNumber("w_h", width, 0.2 * width, 1e-3, max(0.04, 0.5 * (high - low)))
    places = [float(at) for at in np.linspace(low, high, 7)[1:-1]]
    found = [CandidateEffect(effect, (height, place, size), tuple((0.3, at, width) for at in places))]
    if high - low < REACH:
        return found
    # Two looser spots at one place, or waves, leave no friction beyond these bounds.
    half, crest = replace(height, lower=0.5 * (LEAST - 1.0)), replace(height, upper=1.0 - LEAST)
    second = (replace(half, name="h_FR2", nominal=context.value("h_FR2")), replace(place, name="x_h2"))
    narrow = replace(size, upper=0.3 * (high - low))
    pairs = tuple((0.3, a, 0.6 * width, 0.3, b) for a, b in combinations(places, 2))
    found.append(CandidateEffect(effect, (half, place, narrow, *second), pairs))
    waves = FreeNumber("n_h", 0.0, 0.1 / (high - low), 0.0, 1e3)
    numbers = [float(number) for number in NUMBERS / (high - low)]
    starts = tuple((0.15, at / number, number) for number in numbers for at in (0.0, 0.25))
    found.append(CandidateEffect(effect, (crest, place, waves), starts))
    terms = tuple(
        replace(effect_number(effect, context, name, 0.1), lower=-LARGEST, upper=LARGEST) for name in COEFFICIENTS
    )
    known = any(term.nominal != 0.0 for term in terms)
    edges = (context.value("x_a"), context.value("x_b")) if known else (low, high)
    ends = tuple(FreeNumber(name, at, width, fixed=True) for name, at in zip(("x_a", "x_b"), edges, strict=True))
    found.append(CandidateEffect(effect, (*terms, *ends), starting_points((*terms, *ends), 0.0)))
    return found


effect = Effect(
    name="position_dependent_friction",
    place="force",
    summary="friction of rod or gear is higher around one position: a tight spot",
    fingerprint="a bump of dP at the same position in both directions, with the sign of the speed",
    changes={"F_FR": friction},
    parameters=(
        EffectParameter("h_FR", "1", "height of the bump, in A_FR", 0.0, 0.5, -0.95, 10.0),
        EffectParameter("x_h", "m", "its position", 0.0, 0.0, -100.0, 100.0, shape=True),
        EffectParameter("w_h", "m", "its width", 0.015, 0.015, 1e-3, 10.0, shape=True),
        EffectParameter("n_h", "1/m", "waves per length; zero: a spot", 0.0, 0.0, 0.0, 1e3, shape=True),
        EffectParameter("h_FR2", "1", "height of a second spot, in A_FR", 0.0, 0.0, -0.95, 10.0, shape=True),
        EffectParameter("x_h2", "m", "its position", 0.0, 0.0, -100.0, 100.0, shape=True),
        *(
            EffectParameter(c, "1", f"logarithm of a free profile, cosine {c[4:]}", 0.0, 0.0, -3.0, 3.0)
            for c in COEFFICIENTS
        ),
        EffectParameter("x_a", "m", "where the free profile begins", -0.1, -0.1, -100.0, 100.0),
        EffectParameter("x_b", "m", "where it ends", 0.1, 0.1, -100.0, 100.0),
    ),
    candidates=candidates,
    source="form assumed",
)
