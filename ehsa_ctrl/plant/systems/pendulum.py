"""A geared DC motor that swings an arm with a weight: a servo on a pendulum bench, with three forms of its drive.

`pendulum`: the firmware's position loop. The duty cycle of the supply is proportional to the position error in counts
of the encoder, as in the Dynamixel XL330, and a record is replayed in closed loop from its goal. `pendulum_voltage` and
`pendulum_current`: a prescribed voltage or current.

Motor torque by voltage, gravity, and friction at the output: M. Duclusaud, G. Passault, V. Padois, O. Ly, "Extended
friction models for the physics simulation of servo actuators", arXiv 2410.08650, and the documentation of their program
(bam.readthedocs.io). Torque constant, resistance and inertia are effective values at the output of the gear.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, sin

from ..system import Balance, Contact, Entry, ParameterKind, State, System

#: Standard gravity [m/s2].
GRAVITY = 9.80665
#: Duty cycle per radian of position error and unit of kp: encoder counts per radian over the divisor of the gain, 256,
#: and the full scale of the PWM register, 885. Checked on the published records: over all unsaturated samples the
#: logged register is 877 to 885 times the duty cycle computed with it.
DUTY_PER_RADIAN = 4096.0 / (2.0 * pi) / (256.0 * 885.0)


def duty_cycle(goal: float, theta: float, kp: float) -> float:
    """Share of the supply voltage that the position loop applies, -1 to 1."""
    return max(min((goal - theta) * kp * DUTY_PER_RADIAN, 1.0), -1.0)


def supplied_voltage(duty: float, U_0: float) -> float:
    """Mean voltage at the motor [V], the supply without load."""
    return duty * U_0


def supplied_current(voltage: float, duty: float, omega: float, K_T: float, R: float, R_S: float) -> float:
    """Current of the winding [A] where the supply has a resistance.

    The bridge takes duty * current from the supply, so the winding sees R_S duty^2 in series with its own resistance.
    """
    return (voltage - K_T * omega) / (R + R_S * duty * duty)


def winding_current(voltage: float, omega: float, K_T: float, R: float) -> float:
    """Current of a winding without inductance [A]; K_T is also the constant of the back EMF."""
    return (voltage - K_T * omega) / R


def torque(current: float, K_T: float) -> float:
    """Motor torque at the output of the gear [N m]."""
    return K_T * current


def enabled_torque(current: float, K_T: float, released: float) -> float:
    """Motor torque [N m]; none while the motor is released (released = 1), because no current flows."""
    return K_T * current * (1.0 - released)


def load_torque(theta: float, m: float, l: float, offset: float) -> float:  # noqa: E741 - the usual letter of a length
    """Torque of gravity against positive motion [N m]; theta = 0 hangs down if offset is zero."""
    return m * GRAVITY * l * sin(theta + offset)


def gear_torque(T_M: float, T_L: float) -> float:
    """Torque that the gear transmits [N m]: mean of motor and load side, which differ by inertia and friction."""
    return 0.5 * (T_M + T_L)


def inertia(J_M: float, m: float, l: float) -> float:  # noqa: E741
    """Inertia about the output shaft [kg m2]; the weight is a point mass."""
    return J_M + m * l * l


def net_torque(T_M: float, T_L: float) -> float:
    """Torque on the arm without friction [N m]; while the gear sticks, friction balances it."""
    return T_M - T_L


def disturbed_net_torque(T_M: float, T_L: float, T_D: float) -> float:
    """As `net_torque`, with an external torque in the direction of motion."""
    return T_M - T_L + T_D


def acceleration(T_net: float, T_FM: float, J: float) -> float:
    """d omega/dt [rad/s2]."""
    return (T_net - T_FM) / J


def angle_rate(omega: float) -> float:
    """d theta/dt [rad/s]."""
    return omega


def torque_residual(T_net: float, T_FM: float, J: float, omega_rate: float) -> float:
    """Net torque less friction and inertia [N m]."""
    return T_net - T_FM - J * omega_rate


GEAR = Contact(
    name="shaft",
    velocity="omega",
    net="T_net",
    friction="T_FM",
    direction="d_M",
    suffix="FM",
    effort_unit="N m",
    length_unit="rad",
    effort_scale=0.1,
    bristle=State("z_M", "rad", 1e-3),
    # Engineering judgement: the published fits of small servos have 0.1 to 1 rad/s.
    stribeck_speed=0.3,
    position="theta",
    efforts=("T_G", "T_M", "T_L"),
)

BALANCE = Balance("torque", "N m", (torque_residual,), ("T_M",), contacts=("shaft",), entries=(Entry("omega", ("J",)),))

SHARED = (
    ParameterKind("K_T", "N m/A", "torque constant at the gear's output", 0.0, lower_open=True, prior=0.1),
    ParameterKind("J_M", "kg m2", "inertia of motor and gear at the output", 0.0, lower_open=True, prior=0.2),
    ParameterKind("m", "kg", "mass at the end of the arm", 0.0, lower_open=True, prior=0.05),
    ParameterKind("l", "m", "length of the arm", 0.0, lower_open=True),
    ParameterKind("offset", "rad", "angle of the arm from hanging down at theta = 0"),
    ParameterKind("theta_0", "rad", "angle at rest"),
)
# Engineering judgement: seldom measured, and copper alone changes by 0.4 % a kelvin.
WINDING = ParameterKind("R", "ohm", "resistance of winding and bridge", 0.0, lower_open=True, prior=0.3)

system = System(
    name="pendulum",
    title="geared DC motor with an arm and a weight under the firmware's position loop",
    states=(State("omega", "rad/s", 1.0), State("theta", "rad", 0.1)),
    no_controller="its position loop is the firmware's and part of the system, so that every simulation is one in "
    "closed loop; set its gain with --set kp=VALUE",
    inputs=("goal", "released"),
    drives={"goal": "goal", "released": "released"},
    outputs={"angle": "theta"},
    units={"goal": "rad", "released": "1", "angle": "rad"},
    start={"theta": "theta_0"},
    missing_effects=(("motor_friction", "motor_viscous_friction"),),
    # The one contact is the gear; its friction takes the part of the rod's in the catalogue, and the torque that the
    # gear transmits that of the piston force.
    symbols={
        "M": "m",
        "F_FR": "T_FM",
        "F_P": "T_G",
        "d_R": "d_M",
        "v": "omega",
        "x": "theta",
        "A_FR": "A_FM",
        "B_FR": "B_FM",
    },
    contacts=(GEAR,),
    equations=(
        ("duty", duty_cycle),
        ("voltage", supplied_voltage),
        ("current", supplied_current),
        ("T_M", enabled_torque),
        ("T_L", load_torque),
        ("T_G", gear_torque),
        ("T_net", net_torque),
        ("J", inertia),
        ("omega_dot", acceleration),
        ("theta_dot", angle_rate),
    ),
    parameters=(
        *SHARED,
        WINDING,
        ParameterKind("U_0", "V", "supply voltage without load", 0.0, lower_open=True),
        ParameterKind("R_S", "ohm", "resistance of supply and leads", 0.0),
        ParameterKind("kp", "1", "proportional gain in the firmware's unit", 0.0, lower_open=True),
    ),
    balances=(BALANCE,),
)

by_voltage = replace(
    system,
    name="pendulum_voltage",
    no_controller="sampled controllers act on the position of a rod or carriage, and this system has an angle",
    title="geared DC motor with an arm and a weight under a given voltage",
    inputs=("voltage", "T_D"),
    drives={"voltage": "voltage"},
    units={"voltage": "V", "angle": "rad"},
    equations=(
        ("current", winding_current),
        ("T_M", torque),
        ("T_L", load_torque),
        ("T_G", gear_torque),
        ("T_net", disturbed_net_torque),
        *system.equations[-3:],
    ),
    parameters=(*SHARED, WINDING),
    balances=(replace(BALANCE, entries=(Entry("T_D"),)),),
)

by_current = replace(
    by_voltage,
    name="pendulum_current",
    title="geared DC motor with an arm and a weight under a given current",
    inputs=("current", "T_D"),
    drives={"current": "current"},
    units={"angle": "rad"},
    equations=by_voltage.equations[1:],
    parameters=SHARED,
    balances=(replace(BALANCE, entries=(Entry("current", ("K_T",)),)),),
)

systems = (system, by_voltage, by_current)
