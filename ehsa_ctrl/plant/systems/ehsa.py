"""The electro-hydrostatic actuator of the paper: (12), with five states and friction (8) at shaft and rod.

With viscous friction and constant volumes, the same equations are (6); see `structure.LINEAR`.
"""

from __future__ import annotations

from math import inf

from ...physics import chambers, load, motor, pump, residuals, rod, tank
from ..system import Balance, Contact, Entry, ParameterKind, ScalarFunction, ScoredSignal, State, System

SHAFT = Contact(
    name="shaft",
    velocity="omega",
    net="T_net",
    friction="T_FM",
    direction="d_M",
    suffix="FM",
    effort_unit="N m",
    length_unit="rad",
    effort_scale=1.0,
    bristle=State("z_M", "rad", 1e-3),
    stribeck_speed=10.0,
)
ROD = Contact(
    name="rod",
    velocity="v",
    net="F_net",
    friction="F_FR",
    direction="d_R",
    suffix="FR",
    effort_unit="N",
    length_unit="m",
    effort_scale=1e3,
    bristle=State("z_R", "m", 1e-5),
    stribeck_speed=0.007,
    constant="F_0",
    position="x",
)

#: Form of the chamber volumes, as named in a plant's TOML -> equations.
CHAMBER_FORMS: dict[str, tuple[tuple[str, ScalarFunction], ...]] = {
    "constant": (("V_1", chambers.constant_volume), ("V_2", chambers.constant_volume)),
    "stroke": (("V_1", chambers.stroke_volume_1), ("V_2", chambers.stroke_volume_2)),
}

#: From the current to the force on the piston, independent of the load at the rod.
SHAFT_TO_PISTON: tuple[tuple[str, ScalarFunction], ...] = (
    ("T_M", motor.torque),
    ("T_P", pump.torque),
    ("T_net", motor.net_torque),
    ("omega_dot", motor.acceleration),
    ("Q_P", pump.flow),
    ("Q_1", chambers.inflow_1),
    ("Q_2", chambers.outflow_2),
    ("Q_T1", tank.closed),
    ("Q_T2", tank.closed),
    ("P_1_dot", chambers.pressure_rate_1),
    ("P_2_dot", chambers.pressure_rate_2),
    ("F_P", rod.pressure_force),
)

FLOW = Balance(
    "flow",
    "m3/s",
    (residuals.flow_1, residuals.flow_2),
    ("Q_P", "Q_P"),
    closed=("Q_T1", "Q_T2"),
    entries=(Entry("P_1", ("V_1", "beta")), Entry("P_2", ("V_2", "beta"))),
)
TORQUE = Balance(
    "torque", "N m", (residuals.torque,), ("T_M",), contacts=("shaft",), entries=(Entry("current", ("K_T",)),)
)
FORCE = (Entry("F_D"),)

#: Slope of the position over 20 ms: five samples at 250 Hz. Noise of the logged current makes the position of any free
#: run drift by about 0.15 mm.
ROD_VELOCITY = ScoredSignal("rod_velocity", "position", span=0.02, drift=1.5e-4)

system = System(
    name="ehsa",
    title="electro-hydrostatic actuator: motor, pump, cylinder, load",
    states=(
        State("omega", "rad/s", 100.0),
        State("P_1", "Pa", 5e5),
        State("P_2", "Pa", 5e5),
        State("v", "m/s", 0.05),
        State("x", "m", 0.02),
    ),
    inputs=("current", "F_D"),
    drives={"current": "current"},
    outputs={"speed": "omega", "p1": "P_1", "p2": "P_2", "position": "x"},
    chamber_forms=CHAMBER_FORMS,
    start={"P_1": "P_0", "P_2": "P_0", "x": "x_0"},
    scored=(*(ScoredSignal(channel, channel) for channel in ("speed", "p1", "p2")), ROD_VELOCITY),
    # Engineering judgement: slow and weak against the excitation, 20 A/m and 1 A at most.
    centring=(20.0, 1.0),
    cell="F_cell",
    measured=("force",),
    # Dry friction of both contacts, and the stroke in the volumes.
    missing_effects=(
        ("motor_friction", "rod_friction"),
        ("motor_friction", "rod_friction", "chamber_volume_variation"),
    ),
    contacts=(SHAFT, ROD),
    # Contacts with loads behind a gap; resolved to 1e-9 of this length [m] at the default tolerance.
    kinks={"x_into": 0.02, "x_from": 0.02},
    equations=(
        *SHAFT_TO_PISTON,
        ("x_into", load.penetration),
        ("x_from", load.clearance),
        ("s", load.deflection),
        ("F_EXT", load.force),
        ("F_net", rod.net_force),
        ("v_dot", rod.acceleration),
        ("x_dot", rod.velocity),
        ("F_cell", load.cell_force),
    ),
    parameters=(
        ParameterKind("J_M", "kg m2", "inertia of motor, pump and coupling", 0.0, lower_open=True, prior=0.1),
        ParameterKind("K_T", "N m/A", "torque constant", 0.0, lower_open=True, prior=0.05),
        ParameterKind("D", "m3/rad", "pump displacement", 0.0, lower_open=True),
        ParameterKind("K_L", "m3/(Pa s)", "leakage of pump and cylinder", 0.0, prior=0.15),
        ParameterKind("V", "m3", "volume of either chamber", 0.0, lower_open=True, prior=0.1),
        ParameterKind("V_10", "m3", "volume of chamber 1 at x = 0", 0.0, lower_open=True, prior=0.1),
        ParameterKind("V_20", "m3", "volume of chamber 2 at x = 0", 0.0, lower_open=True, prior=0.1),
        ParameterKind("beta", "Pa", "bulk modulus of the oil", 0.0, lower_open=True, prior=0.1, searched=False),
        ParameterKind("A", "m2", "piston area", 0.0, lower_open=True),
        ParameterKind("M", "kg", "mass of rod and piston", 0.0, lower_open=True, prior=0.1),
        ParameterKind("P_0", "Pa", "pressure at rest, gauge", -1.01325e5),
        ParameterKind("x_0", "m", "rod position at rest"),
        ParameterKind("K_S", "N/m", "spring of the load (load.stiffness)", 0.0, prior=0.1, default=0.0),
        ParameterKind("F_pre", "N", "preload of that spring (load.preload)", default=0.0),
        ParameterKind("k_3", "N/m3", "hardening of that spring (load.hardening)", default=0.0),
        ParameterKind("F_0", "N", "constant force of the load (load.force)", default=0.0),
        ParameterKind("m_L", "kg", "mass of the load, behind the load cell (load.mass)", 0.0, default=0.0),
        ParameterKind(
            "x_C", "m", "position at which the rod meets the load (load.gap); -inf: attached", -inf, default=-inf
        ),
        ParameterKind(
            "x_R", "m", "the same for a retracting rod (load.gap_retracting); -inf: none there", -inf, default=-inf
        ),
    ),
    balances=(
        FLOW,
        TORQUE,
        Balance("force", "N", (residuals.rod_force,), ("F_P",), contacts=("rod",), entries=FORCE),
        Balance(
            "force, nominal load",
            "N",
            (residuals.nominal_load_force,),
            ("F_P",),
            ("rod",),
            without="force",
            entries=FORCE,
        ),
        Balance("load", "N", (residuals.load_force,), ("force_measured",)),
    ),
)
