"""Static, Coulomb and viscous friction: the paper's law (8)."""

from math import exp

from ._law import FrictionLaw


def effort(direction: float, speed: float, A: float, B: float, C: float, tau: float) -> float:
    """F = A sign(v) + B v + C sign(v) exp(-|v|/tau), equation (8).

    During sliding |v| = direction * v. In this form the law is smooth up to v = 0, so that the engine can locate the
    instant of standstill. At v = 0 it is the breakaway effort A + C.
    """
    return direction * (A + C * exp(-direction * speed / tau)) + B * speed


law = FrictionLaw("stribeck", "A sign(v) + B v + C sign(v) exp(-|v|/tau), the paper's (8)", effort, sticks=True)
