"""Karnopp's dead band, for comparison with exact sticking.

Below v_band the speed counts as zero and friction balances the net effort up to its static level; the contact is
captured on entering the band instead of at v = 0, so that a fixed-step simulation never has to hit zero. What it
costs is the momentum M v_band that vanishes at each capture, and reversals that come early.

Source: D. Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic systems", ASME J. Dyn. Syst.
Meas. Control 107(1), 1985; the capture rule here is our reading of it for an engine with event location.
"""

from math import exp

from ._law import FrictionLaw


def effort(direction: float, speed: float, A: float, B: float, C: float, tau: float) -> float:
    """F = A sign(v) + B v + C sign(v) exp(-|v|/tau) outside the band: equation (8)."""
    return direction * (A + C * exp(-direction * speed / tau)) + B * speed


law = FrictionLaw("karnopp", "(8) with a dead band |v| < v_band", effort, sticks=True, band="v_band")
