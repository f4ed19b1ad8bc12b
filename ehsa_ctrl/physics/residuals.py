"""The balances as sums that vanish in the true plant: for estimating parameters from measured signals and rates.

The same equations as in motor.py, chambers.py and rod.py, not solved for the rates, so that they are linear in what
is to be estimated. `..._rate` is a measured time derivative, `..._measured` a channel of the log.
"""

#: Standard atmosphere, against which gas springs push [Pa].
P_ATM = 101325.0


def torque(T_M: float, T_P: float, T_FM: float, J_M: float, omega_rate: float) -> float:
    """Equation (1) with friction (9): T_M - T_P - T_FM - J_M d omega/dt [N m]."""
    return T_M - T_P - T_FM - J_M * omega_rate


def flow_1(Q_1: float, Q_T1: float, v: float, V_1: float, A: float, beta: float, P_1_rate: float) -> float:
    """Equation (4.a): what flows in less what the piston leaves room for and what compresses the oil [m3/s]."""
    return Q_1 + Q_T1 - A * v - V_1 / beta * P_1_rate


def flow_2(Q_2: float, Q_T2: float, v: float, V_2: float, A: float, beta: float, P_2_rate: float) -> float:
    """Equation (4.b) [m3/s]."""
    return A * v - Q_2 + Q_T2 - V_2 / beta * P_2_rate


def rod_force(F_P: float, F_FR: float, force_measured: float, M: float, v_rate: float) -> float:
    """Equation (5) with friction (10), F_EXT as the load cell shows it, the load's inertia included [N]."""
    return F_P - F_FR - force_measured - M * v_rate


def nominal_load_force(F_P: float, F_FR: float, F_EXT: float, M: float, m_L: float, v_rate: float) -> float:
    """Equation (5) with friction (10), F_EXT as the load's parameters say: where there is no load cell [N]."""
    return F_P - F_FR - F_EXT - (M + m_L) * v_rate


def load_force(F_EXT: float, force_measured: float, m_L: float, v_rate: float) -> float:
    """What the load cell shows less what the load's parameters say [N]."""
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
    """Force on a rod with gas springs beside the piston, spring 1 pushing it out as chamber 1 does [N].

    Pressures of the springs are absolute.
    """
    springs = A_S1 * (spring_p1_measured - P_ATM) - A_S2 * (spring_p2_measured - P_ATM)
    return F_P + springs - F_FR - force_measured - M * v_rate


def carriage_force(F_net: float, F_FR: float, M: float, v_rate: float) -> float:
    """Force balance of a carriage [N]: drive less offset and outer force, less friction, less inertia."""
    return F_net - F_FR - M * v_rate
