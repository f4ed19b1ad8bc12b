"""Residuals of the balances, zero in the true plant, to estimate parameters from measured signals and rates.

The equations are those of motor.py, chambers.py and rod.py, but not solved for the rates, so that they are linear in
the estimated parameters. `..._rate` is a measured time derivative, `..._measured` a channel of the log.
"""

#: Standard atmosphere [Pa]; the pressures of the gas springs are absolute.
P_ATM = 101325.0


def torque(T_M: float, T_P: float, T_FM: float, J_M: float, omega_rate: float) -> float:
    """Equation (1) with friction (9): T_M - T_P - T_FM - J_M d omega/dt [N m]."""
    return T_M - T_P - T_FM - J_M * omega_rate


def flow_1(Q_1: float, Q_T1: float, v: float, V_1: float, A: float, beta: float, P_1_rate: float) -> float:
    """Equation (4.a): inflow less displacement of the piston and compression of the oil [m3/s]."""
    return Q_1 + Q_T1 - A * v - V_1 / beta * P_1_rate


def flow_2(Q_2: float, Q_T2: float, v: float, V_2: float, A: float, beta: float, P_2_rate: float) -> float:
    """Equation (4.b) [m3/s]."""
    return A * v - Q_2 + Q_T2 - V_2 / beta * P_2_rate


def rod_force(F_P: float, F_FR: float, force_measured: float, M: float, v_rate: float) -> float:
    """Equation (5) with friction (10) [N]; F_EXT and the load's inertia are in the reading of the load cell."""
    return F_P - F_FR - force_measured - M * v_rate


def nominal_load_force(F_P: float, F_FR: float, F_EXT: float, M: float, m_L: float, v_rate: float) -> float:
    """Equation (5) with friction (10) [N]; without a load cell, F_EXT follows from the load's parameters."""
    return F_P - F_FR - F_EXT - (M + m_L) * v_rate


def load_force(F_EXT: float, force_measured: float, m_L: float, v_rate: float) -> float:
    """Reading of the load cell less the force that the load's parameters predict [N]."""
    return force_measured - F_EXT - m_L * v_rate


def take_off_force(
    F_P: float,
    F_FR: float,
    spring_p1_measured: float,
    spring_p2_measured: float,
    force_measured: float,
    A_S1: float,
    A_S2: float,
    M: float,
    v_rate: float,
) -> float:
    """Force balance of a rod with two gas springs [N]; spring 1 pushes it out, as chamber 1 does.

    The pressures of the springs are absolute.
    """
    springs = A_S1 * (spring_p1_measured - P_ATM) - A_S2 * (spring_p2_measured - P_ATM)
    return F_P + springs - F_FR - force_measured - M * v_rate


def carriage_force(F_net: float, F_FR: float, M: float, v_rate: float) -> float:
    """Force balance of a carriage [N]: net force less friction and inertia."""
    return F_net - F_FR - M * v_rate
