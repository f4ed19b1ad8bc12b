"""Motor, pump and cylinder whose rod is moved by something else: an electro-hydraulic power take-off.

Shaft and chambers are those of the EHSA. The rod's motion is an input, so its force balance plays no part in a
simulation; with the force and the pressures of gas springs beside the piston measured, it tells areas and friction.
"""

from __future__ import annotations

from ...physics import residuals
from ..system import Balance, ParameterKind, System
from .ehsa import CHAMBER_FORMS, ROD, SHAFT, SHAFT_TO_PISTON
from .ehsa import system as ehsa

_SAME = {kind.name: kind for kind in ehsa.parameters}

system = System(
    name="driven_rod",
    title="power take-off: motor, pump and cylinder with a prescribed rod motion",
    states=tuple(state for state in ehsa.states if state.name in ("omega", "P_1", "P_2")),
    inputs=("current", "v"),
    drives={"current": "current", "v": "velocity"},
    outputs={"speed": "omega", "p1": "P_1", "p2": "P_2"},
    hold="first_order",
    # Without the position as a state the volumes can't follow the stroke.
    chamber_forms={"constant": CHAMBER_FORMS["constant"]},
    start={"P_1": "P_0", "P_2": "P_0"},
    measured=("position", "force", "spring_p1", "spring_p2"),
    lacking=(("motor_friction", "motor_viscous_friction"),),
    contacts=(SHAFT,),
    prescribed=(ROD,),
    equations=SHAFT_TO_PISTON,
    parameters=(
        *(_SAME[name] for name in ("J_M", "K_T", "D", "K_L", "V", "beta", "A", "M", "P_0")),
        ParameterKind("A_S1", "m2", "area of the gas spring that pushes the rod out", 0.0),
        ParameterKind("A_S2", "m2", "area of the gas spring that pushes the rod in", 0.0),
    ),
    # The force is measured, so it says how large the areas are; flow and torque then follow from the areas.
    balances=(
        Balance("force", "N", (residuals.take_off_force,), ("force_measured",), contacts=("rod",)),
        Balance("flow", "m3/s", (residuals.flow_1, residuals.flow_2), ("Q_P", "Q_P"), closed=("Q_T1", "Q_T2")),
        Balance("torque", "N m", (residuals.torque,), ("T_M",), contacts=("shaft",)),
    ),
)
