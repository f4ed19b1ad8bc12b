"""Karnopp's dead band, for comparison with exact sticking.

Below v_band the speed counts as zero and friction balances the net effort up to its static level. The contact sticks on
entering the band instead of at v = 0, so that a fixed-step simulation need not hit zero. The price: each time the
momentum M v_band vanishes, and reversals come early.

Source: D. Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic systems", ASME J. Dyn. Syst.
Meas. Control 107(1), 1985. The rule for entering the band is adapted to an engine with event location.
"""

from math import exp

from ._law import FrictionLaw


def effort(direction: float, speed: float, A: float, B: float, C: float, tau: float) -> float:
    """F = A sign(v) + B v + C sign(v) exp(-|v|/tau) outside the band: equation (8)."""
    return direction * (A + C * exp(-direction * speed / tau)) + B * speed


law = FrictionLaw("karnopp", "(8) with a dead band |v| < v_band", effort, sticks=True, band="v_band")
