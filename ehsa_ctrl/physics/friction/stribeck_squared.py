"""Stribeck friction with a squared exponent, flat at v = 0, as in many textbooks."""

from math import exp

from ._law import FrictionLaw


def effort(direction: float, speed: float, A: float, B: float, C: float, tau: float) -> float:
    """F = A sign(v) + B v + C sign(v) exp(-(v/tau)^2)."""
    return direction * (A + C * exp(-(speed / tau) * (speed / tau))) + B * speed


law = FrictionLaw("stribeck_squared", "A sign(v) + B v + C sign(v) exp(-(v/tau)^2)", effort, sticks=True)
