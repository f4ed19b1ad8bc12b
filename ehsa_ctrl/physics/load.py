"""Load of the rod: F_EXT of (5), positive when it resists extension.

A load with a gap, such as a workpiece, is not attached to the rod: it pushes once the rod has reached x_C, and never
pulls. Without one, x_C is minus infinity.
"""

from math import inf


def penetration(x: float, x_C: float) -> float:
    """How far the rod is beyond the position x_C at which it meets the load [m]; negative before contact."""
    return x - x_C


def deflection(x: float, x_C: float) -> float:
    """Deflection of the load's spring [m]: x where it is attached to the rod, else the penetration in contact."""
    return x if x_C == -inf else max(x - x_C, 0.0)


def force(s: float, K_S: float, F_pre: float, k_3: float, F_0: float, F_D: float) -> float:
    """F_EXT [N]: a spring K_S at the deflection s, with preload F_pre and hardening k_3 s^3, a constant force F_0
    and an external force F_D(t). `rod.acceleration` includes the inertia of the load's mass."""
    return s * (K_S + k_3 * s * s) + (F_pre + F_0) + F_D


def cell_force(F_EXT: float, v_dot: float, m_L: float) -> float:
    """Reading of a load cell between rod and load [N]: it includes the inertia of the load, not of the rod."""
    return F_EXT + m_L * v_dot
