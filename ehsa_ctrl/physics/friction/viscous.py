"""Viscous friction alone: what the linear model (6), (7) knows of friction."""

from ._law import FrictionLaw


def effort(speed: float, B: float) -> float:
    """F = B v, equations (1) and (5)."""
    return B * speed


law = FrictionLaw("viscous", "B v", effort, sticks=False)
