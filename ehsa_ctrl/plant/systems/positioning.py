"""A carriage on a rail with friction under a given drive force: the electro-mechanical positioning system EMPS.

Equations and the symbols M, Fv, Fc, offset: A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS",
Nonlinear System Identification Benchmarks, 2019. Their balance uses force and motion of the same sample, so the force
is interpolated linearly; a zero-order hold would delay it by half a sample.
"""

from __future__ import annotations

from ...physics import carriage, residuals, rod
from ..system import Balance, Contact, Entry, ParameterKind, State, System
from .ehsa import ROD_VELOCITY

CARRIAGE = Contact(
    name="rod",
    velocity="v",
    net="F_net",
    friction="F_FR",
    direction="d_R",
    suffix="FR",
    effort_unit="N",
    length_unit="m",
    effort_scale=10.0,
    bristle=State("z_R", "m", 1e-5),
    stribeck_speed=0.007,
    symbols={"A": "Fc", "B": "Fv"},
    constant="F_0",
    position="x",
    acceleration_channel="acceleration",
    efforts=("F_M",),
)

system = System(
    name="positioning",
    title="carriage on a rail under a given drive force",
    states=(State("v", "m/s", 0.05), State("x", "m", 0.02)),
    inputs=("F_M", "F_D"),
    drives={"F_M": "drive_force"},
    outputs={"position": "x", "velocity": "v"},
    hold="first_order",
    # Engineering judgement: 500 N/m and 50 N at most, somewhat more than the friction of such an axis.
    centring=(500.0, 50.0),
    scored=(ROD_VELOCITY,),
    start={"x": "x_0"},
    measured=("acceleration",),
    missing_effects=(
        ("rod_viscous_friction", "rod_friction", "constant_force"),
        ("rod_viscous_friction", "rod_friction"),
    ),
    symbols={"F_0": "offset"},
    contacts=(CARRIAGE,),
    equations=(
        ("F_net", carriage.net_force),
        ("v_dot", carriage.acceleration),
        ("x_dot", rod.velocity),
    ),
    parameters=(
        ParameterKind("M", "kg", "moving mass, the drive's inertia included", 0.0, lower_open=True, prior=0.1),
        ParameterKind("offset", "N", "constant force against the drive: its bias, or gravity"),
        ParameterKind("x_0", "m", "position at rest"),
    ),
    balances=(
        Balance("force", "N", (residuals.carriage_force,), ("F_M",), contacts=("rod",), entries=(Entry("F_D"),)),
    ),
)
