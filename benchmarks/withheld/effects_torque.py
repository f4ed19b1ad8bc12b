"""Effects in the torque balance and in the drive."""

from __future__ import annotations

from math import pi

from cause import Conditions, Effect, choose_law, random_sign, scale_parameter, set_parameter
from equivalent_ids import equivalents


def draw_torque(c: Conditions, id: str) -> Effect:
    match id:
        case "torque_constant":
            return scale_parameter("K_T", id, "constant", random_sign(c), 0.004, 0.25, also=equivalents(id))
        case "torque_saturation":
            law, k = choose_law(c, "rational", "tanh", "atan")
            return set_parameter(id, law, "k_sat", 0.02, 0.5, saturation_law=k)
        case "rotor_inertia":
            return scale_parameter("J_M", id, "constant", random_sign(c), 0.02, 1.2)
        case "motor_friction":
            law, k = choose_law(c, "Coulomb", "Coulomb and Stribeck")
            return scale_parameter("A_FM", id, law, random_sign(c), 0.01, 0.35, *(["C_FM"] if k else []))
        case "motor_viscous_friction":
            return scale_parameter("B_FM", id, "constant", random_sign(c), 0.01, 0.8)
        case "torque_ripple":
            order = float(c.rng.choice([1, 2, 3, 4, 6]))
            return set_parameter(
                id,
                f"{order:.0f} a turn",
                "T_c",
                0.03,
                0.8,
                ripple_order=order,
                ripple_phase=c.rng.uniform(0.0, 2.0 * pi),
            )
        case "pump_torque_loss":
            law, k = choose_law(c, "constant", "mixed film")
            return set_parameter(id, law, "c_f", 0.005, 0.3, loss_law=k)
        case "current_offset":
            return set_parameter(id, "constant", "I_0", 0.003, 0.3, direction=random_sign(c), also=equivalents(id))
        case "drive_lag":
            law, k = choose_law(c, "first order", "two equal lags")
            return set_parameter(id, law, "tau_I", 3e-4, 0.02, lag_law=k)
        case "drive_delay":
            return set_parameter(id, "constant", "T_d", 3e-4, 0.02)
        case "windage":
            return set_parameter(id, "square of the speed", "windage", 1e-7, 1e-5, label="k_w")
        case "drive_dead_band":
            return set_parameter(id, "dead zone", "drive_dead_band", 0.005, 0.5, label="I_db")
    raise KeyError(id)
