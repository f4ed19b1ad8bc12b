"""Cylinder chambers: continuity of compressible oil, (4) with constant and (11) with stroke-dependent volumes.

Both conserve volume, not mass (see `effects/mass_conserving.py`): the pump takes a volume of oil out of one chamber and
delivers the same volume into the other, whatever their pressures.
"""


def constant_volume(V: float) -> float:
    """V_1 = V_2 = V [m3], the simplification that leads from (6) to (7)."""
    return V


def stroke_volume_1(x: float, V_10: float, A: float) -> float:
    """V_1 = V_10 + A x [m3], equation (11.a)."""
    return V_10 + A * x


def stroke_volume_2(x: float, V_20: float, A: float) -> float:
    """V_2 = V_20 - A x [m3], equation (11.b)."""
    return V_20 - A * x


def inflow_1(Q_P: float) -> float:
    """Q_1 [m3/s]: volume flow into chamber 1, equal to that of the pump less leakage."""
    return Q_P


def outflow_2(Q_P: float) -> float:
    """Q_2 [m3/s]: volume flow out of chamber 2, the same as into chamber 1."""
    return Q_P


def pressure_rate_1(Q_1: float, Q_T1: float, v: float, V_1: float, A: float, beta: float) -> float:
    """dP_1/dt [Pa/s], equations (4.a), (11.a); Q_1 comes from the pump, Q_T1 from the tank."""
    return beta * (Q_1 - A * v + Q_T1) / V_1


def pressure_rate_2(Q_2: float, Q_T2: float, v: float, V_2: float, A: float, beta: float) -> float:
    """dP_2/dt [Pa/s], equations (4.b), (11.b); Q_2 goes to the pump, Q_T2 comes from the tank."""
    return beta * (A * v - Q_2 + Q_T2) / V_2
