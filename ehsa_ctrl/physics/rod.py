"""Piston and rod: force balance (5), with friction (10)."""


def pressure_force(P_1: float, P_2: float, A: float) -> float:
    """A (P_1 - P_2) [N], the left side of (5)."""
    return A * (P_1 - P_2)


def net_force(F_P: float, F_EXT: float) -> float:
    """Force on the rod without friction [N]; while the rod sticks, friction balances it."""
    return F_P - F_EXT


def acceleration(F_net: float, F_FR: float, M: float, m_L: float) -> float:
    """dv/dt [m/s2], equation (10); m_L moves with the rod, behind the load cell."""
    return (F_net - F_FR) / (M + m_L)


def velocity(v: float) -> float:
    """dx/dt [m/s], the last line of (12)."""
    return v
