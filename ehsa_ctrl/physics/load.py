"""Load of the rod: F_EXT of (5), positive when it resists extension.

A load with a gap, such as a workpiece, is not attached to the rod: it pushes once the rod has reached x_C, and never
pulls. One that the retracting rod meets pushes the other way below x_R. Without either, both are minus infinity.
"""

from math import inf


def penetration(x: float, x_C: float) -> float:
    """How far the rod is beyond the position x_C at which it meets the load [m]; negative before contact."""
    return x - x_C


def clearance(x: float, x_R: float) -> float:
    """How far the rod is from the position x_R at which it meets the load while retracting [m]; negative in contact."""
    return x - x_R


def deflection(x: float, x_C: float, x_R: float) -> float:
    """Deflection of the load's spring [m]: x where it is attached to the rod, else the penetration in contact, negative
    on the side of retraction. A rod that is between two loads touches neither."""
    pushed = 0.0 if x_C == -inf else max(x - x_C, 0.0)
    return x if max(x_C, x_R) == -inf else pushed + min(x - x_R, 0.0)


def force(s: float, K_S: float, F_pre: float, k_3: float, F_0: float, F_D: float) -> float:
    """F_EXT [N]: a spring K_S at the deflection s, with preload F_pre and hardening k_3 s^3, a constant force F_0
    and an external force F_D(t). `rod.acceleration` includes the inertia of the load's mass."""
    return s * (K_S + k_3 * s * s) + (F_pre + F_0) + F_D


def cell_force(F_EXT: float, v_dot: float, m_L: float) -> float:
    """Reading of a load cell between rod and load [N]: it includes the inertia of the load, not of the rod."""
    return F_EXT + m_L * v_dot
