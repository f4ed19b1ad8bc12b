"""All parameters of the bench: the published nonlinear set, and all effects at their neutral value."""

from __future__ import annotations

from math import inf, pi
from typing import NamedTuple

P_ATM = 101325.0  # Pa


class Rig(NamedTuple):
    """SI units, gauge pressures. Floats only, so that the compiled kernel sees one type whatever is switched on.

    numba caches the kernel until kernel.py changes, and reads fields by position: touch kernel.py after reordering them
    or after a change in laws.py or loop.py.
    """

    # Equation (12) with the friction of (8).
    J_M: float = 3.312e-4
    K_T: float = 1.2
    A_FM: float = 0.8
    B_FM: float = 1.35e-3
    C_FM: float = 0.08
    tau_FM: float = 10.0
    D: float = 3.7e-6 / (2.0 * pi)
    K_L: float = 4.05e-13
    V_10: float = 2.056e-3
    V_20: float = 2.033e-3
    stroke_term: float = 1.0  # 0: the chambers keep their volume, as in (6)
    beta: float = 1.4e9
    A: float = pi / 4.0 * (0.063**2 - 0.045**2)
    M: float = 16.52
    A_FR: float = 854.0
    B_FR: float = 9186.0
    C_FR: float = 213.0
    tau_FR: float = 0.007
    P_0: float = 20e5
    K_S: float = 0.0

    # Torque and drive.
    k_sat: float = 0.0
    saturation_law: float = 0.0  # 0 rational, 1 hyperbolic tangent, 2 arc tangent: equal to second order in I; 3 knee
    T_c: float = 0.0
    ripple_order: float = 6.0
    ripple_phase: float = 0.0
    ripple_second: float = 0.0  # order of a second ripple; 0: none
    ripple_share: float = 0.0  # its amplitude over T_c
    c_f: float = 0.0
    loss_law: float = 0.0  # 0 constant, 1 larger at low speed (mixed film), 2 grows with the speed
    I_0: float = 0.0
    tau_I: float = 0.0
    lag_law: float = 0.0  # 0 one lag, 1 two equal lags of tau_I/2 each, 2 second order with damping 0.5
    T_d: float = 0.0

    # Flow.
    K_t: float = 0.0
    orifice_law: float = 0.0  # 0 regularised root, 1 laminar and turbulent resistance in series, 2 power 0.7
    K_e1: float = 0.0
    K_e2: float = 0.0
    air: float = 0.0
    air_law: float = 0.0  # 0 isothermal, 1 polytropic, 2 polytropic and dissolving, 3 dissolving late
    P_crack: float = inf
    relief_law: float = 0.0  # 0 each chamber to the tank, 1 across the ports, 2 to the tank with hysteresis
    P_open: float = -inf
    dA: float = 0.0
    area_law: float = 0.0  # 0 both sides by half, 1 the front side alone

    # Force.
    kappa: float = 0.0
    seal_law: float = 0.0  # 0 grows with |A dP|, 1 with the higher of the two pressures
    asymmetry: float = 0.0
    asymmetry_law: float = 0.0  # 0 Coulomb part, 1 viscous part too
    h: float = 0.0
    bump_law: float = 0.0  # 0 raised cosine, 1 triangle, 2 Lorentz, 3 waves
    bump_place: float = 0.0
    bump_width: float = 0.01
    bristle: float = 0.0  # 1/sigma_0, m/N; 0: rigid
    bristle_law: float = 0.0  # 0 LuGre, 1 Dahl, 2 Maxwell slip
    R_lam: float = 0.0
    R_turb: float = 0.0
    line_law: float = 0.0  # 0 oil volume at the pump, 1 at the cylinder
    line_exponent: float = 2.0  # of the flow in the turbulent part
    m_load: float = 0.0  # behind the load cell
    m_rod: float = 0.0
    F_0: float = 0.0  # behind the load cell
    F_rod: float = 0.0  # on the rod, unseen by the cell
    k_3: float = 0.0
    hardening_law: float = 0.0  # 0 cubic, 1 hyperbolic sine
    width: float = 0.0
    x_stop: float = inf
    stop_law: float = 0.0  # 0 linear contact, 1 contact that stiffens (Hertz exponent), 2 cushion
    drop: float = 0.0
    warm_law: float = 0.0  # 0 exponential, 1 straight in time, 2 with the heat of the losses
    warm_time: float = 12.0

    displacement_pressure: float = 0.0  # relative loss of displacement at 10 bar
    filling_loss: float = 0.0  # relative loss of displacement at 4500 rpm
    pump_dead_zone: float = 0.0  # rad/s
    windage: float = 0.0  # N m s2
    drive_dead_band: float = 0.0  # A

    # Outside the catalogue.
    flow_ripple: float = 0.0
    flow_order: float = 1.0
    coupling: float = 0.0  # 1/k_c, rad/(N m); 0: rigid
    coupling_play: float = 0.0  # rad
    hose: float = 0.0  # m3/Pa that the walls give way, late
    hose_time: float = 0.3
    leak_growth: float = 0.0  # m3/(s Pa) at the end of 24 s
    one_way_leak: float = 0.0  # m3/(s Pa)
    wander: float = 0.0  # N, scale of an unseen force that wanders
    wander_seed: float = 0.0
    drive_step: float = 0.0  # A
    drive_slope: float = inf  # A/s
    heat_droop: float = 0.0
    memory: float = 0.0  # share of Coulomb friction that comes back only some time after a reversal
    memory_time: float = 0.3
    jam: float = 0.0  # N from jam_time on
    jam_time: float = 10.0
    brake: float = 0.0  # N m below brake_current
    brake_current: float = 0.5


#: Parameters of (12) under their names in --set and identification.
PLANT_PARAMETERS = (
    "J_M", "K_T", "A_FM", "B_FM", "C_FM", "tau_FM", "D", "K_L", "V_10", "V_20", "beta", "A", "M", "A_FR", "B_FR",
    "C_FR", "tau_FR", "P_0",
)  # fmt: skip

#: The published linear set (6), (7): viscous friction alone and one constant volume.
LINEAR = Rig(
    J_M=3.652e-4, A_FM=0.0, B_FM=1.8e-3, C_FM=0.0, K_L=4.13e-13, V_10=2.042e-3, V_20=2.042e-3, stroke_term=0.0,
    M=16.46, A_FR=0.0, B_FR=9712.0, C_FR=0.0,
)  # fmt: skip
