"""Motor, pump and cylinder with a prescribed rod motion: an electro-hydraulic power take-off.

Shaft and chambers are those of the EHSA. The rod's motion is an input, so a simulation does not use its force balance.
With measured force and gas spring pressures, the balance determines areas and friction.
"""

from __future__ import annotations

from dataclasses import replace

from ...physics import residuals
from ..system import Balance, ParameterKind, System
from .ehsa import CHAMBER_FORMS, FLOW, ROD, SHAFT, SHAFT_TO_PISTON, TORQUE
from .ehsa import system as ehsa

_EHSA = {kind.name: kind for kind in ehsa.parameters}

system = System(
    name="driven_rod",
    title="power take-off: motor, pump and cylinder with a prescribed rod motion",
    states=tuple(state for state in ehsa.states if state.name in ("omega", "P_1", "P_2")),
    inputs=("current", "v"),
    drives={"current": "current", "v": "velocity"},
    outputs={"speed": "omega", "p1": "P_1", "p2": "P_2"},
    no_controller="the motion of its rod is prescribed, so that no controller can change it",
    hold="first_order",
    # Stroke volumes need the position as a state.
    chamber_forms={"constant": CHAMBER_FORMS["constant"]},
    start={"P_1": "P_0", "P_2": "P_0"},
    measured=("position", "force", "spring_p1", "spring_p2"),
    # The pump delivers what the rod displaces; compressibility and leakage are small beside it.
    proportional=(("speed", "velocity"),),
    missing_effects=(("motor_friction", "motor_viscous_friction"),),
    contacts=(SHAFT,),
    prescribed=(replace(ROD, position_channel="position"),),
    equations=SHAFT_TO_PISTON,
    parameters=(
        *(_EHSA[name] for name in ("J_M", "K_T", "D", "K_L", "V", "beta", "A", "M", "P_0")),
        ParameterKind("A_S1", "m2", "area of the gas spring that pushes the rod out", 0.0),
        ParameterKind("A_S2", "m2", "area of the gas spring that pushes the rod in", 0.0),
    ),
    # The measured force determines the areas; flow and torque follow from them.
    balances=(
        Balance("force", "N", (residuals.take_off_force,), ("force_measured",), contacts=("rod",)),
        FLOW,
        TORQUE,
    ),
)
