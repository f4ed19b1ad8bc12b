"""Viscous friction, the only friction in the linear models (6) and (7)."""

from ._law import FrictionLaw


def effort(speed: float, B: float) -> float:
    """F = B v, equations (1) and (5)."""
    return B * speed


law = FrictionLaw("viscous", "B v", effort, sticks=False)
