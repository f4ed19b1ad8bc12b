"""Motor shaft, rigidly coupled to the pump: torque balance (1), with friction (9)."""


def torque(current: float, K_T: float) -> float:
    """T_M = K_T I_M [N m], equation (1)."""
    return K_T * current


def net_torque(T_M: float, T_P: float) -> float:
    """Torque on the shaft without friction [N m]; while the shaft sticks, friction balances it."""
    return T_M - T_P


def acceleration(T_net: float, T_FM: float, J_M: float) -> float:
    """d omega/dt [rad/s2], equation (9)."""
    return (T_net - T_FM) / J_M
