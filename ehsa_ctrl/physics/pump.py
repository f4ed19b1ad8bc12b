"""Bidirectional gear pump of fixed displacement: flow (2) and torque (3)."""


def flow(omega: float, P_1: float, P_2: float, D: float, K_L: float) -> float:
    """Q [m3/s] into chamber 1 and out of chamber 2, equation (2); K_L = K_LP + K_LC as in (6)."""
    return D * omega - K_L * (P_1 - P_2)


def torque(P_1: float, P_2: float, D: float) -> float:
    """T_P [N m], torque of the pressures on the shaft, equation (3)."""
    return D * (P_1 - P_2)
