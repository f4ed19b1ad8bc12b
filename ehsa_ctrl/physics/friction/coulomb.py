"""Coulomb and viscous friction: no static overshoot."""

from ._law import FrictionLaw


def effort(direction: float, speed: float, A: float, B: float) -> float:
    """F = A sign(v) + B v: equation (8) with C = 0."""
    return direction * A + B * speed


law = FrictionLaw("coulomb", "A sign(v) + B v", effort, sticks=True)
