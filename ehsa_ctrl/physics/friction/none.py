"""No friction."""

from ._law import FrictionLaw


def effort(speed: float) -> float:
    """F = 0."""
    return 0.0 * speed


law = FrictionLaw("none", "no friction", effort, sticks=False)
