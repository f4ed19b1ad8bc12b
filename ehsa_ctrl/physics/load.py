"""Load of the rod: F_EXT of (5), positive when it resists extension."""


def force(x: float, K_S: float, F_pre: float, k_3: float, F_0: float, F_D: float) -> float:
    """F_EXT [N]: a spring K_S, centred at x = 0, with preload F_pre and hardening k_3 x^3, a constant force F_0
    and an external force F_D(t). `rod.acceleration` includes the inertia of the load's mass."""
    return x * (K_S + k_3 * x * x) + (F_pre + F_0) + F_D


def cell_force(F_EXT: float, v_dot: float, m_L: float) -> float:
    """Reading of a load cell between rod and load [N]: it includes the inertia of the load, not of the rod."""
    return F_EXT + m_L * v_dot
