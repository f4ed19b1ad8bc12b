"""Effects in the force balance: on the rod, in the lines and in the load."""

from __future__ import annotations

from cause import Conditions, Effect, choose_law, random_sign, scale_parameter, set_parameter
from equivalent_ids import equivalents


def draw_rod(c: Conditions, id: str) -> Effect:
    rng = c.rng
    match id:
        case "rod_friction":
            law, k = choose_law(c, "Coulomb", "Coulomb and Stribeck")
            return scale_parameter("A_FR", id, law, random_sign(c), 0.01, 0.6, *(["C_FR"] if k else []))
        case "rod_viscous_friction":
            way = random_sign(c)
            same = equivalents(id, more_drag=way > 0.0)
            return scale_parameter("B_FR", id, "constant", way, 0.01, 0.8, also=same)
        case "load_dependent_friction":
            law, k = choose_law(c, "|A dP|", "higher pressure")
            return set_parameter(id, law, "kappa", 0.003, 0.5, seal_law=k)
        case "asymmetric_friction":
            law, k = choose_law(c, "Coulomb", "Coulomb and viscous")
            return set_parameter(id, law, "asymmetry", 0.005, 0.6, direction=random_sign(c), label="a", asymmetry_law=k)
        case "position_dependent_friction":
            law, k = choose_law(c, "raised cosine", "triangle", "Lorentz")
            place, width = rng.uniform(-0.5, 0.5) * c.reach, rng.uniform(0.15, 0.5) * c.reach
            return set_parameter(id, law, "h", 0.03, 3.0, bump_law=k, bump_place=place, bump_width=width)
        case "presliding":
            law, k = choose_law(c, "LuGre", "Dahl")
            return Effect(
                id, law, lambda b, s: b.with_rig(bristle=s, bristle_law=k), 1e-8, 1e-6,
                lambda b: {"sigma_0": 1.0 / b.rig.bristle},
            )  # fmt: skip
        case "line_pressure_drop":
            law, k = choose_law(
                c, "laminar, oil at the pump", "turbulent, oil at the pump", "turbulent, oil at the cylinder"
            )
            if k == 0.0:
                return set_parameter(id, law, "R_lam", 1e7, 5e9, also=equivalents(id))
            # With the oil at the cylinder the ports see the drop too, and a drag of the rod is something else.
            same = equivalents(id, laminar=False) if k == 1.0 else ()
            return set_parameter(id, law, "R_turb", 3e10, 5e13, also=same, line_law=float(k == 2.0))
    raise KeyError(id)


def draw_load(c: Conditions, id: str) -> Effect:
    rng = c.rng
    match id:
        case "payload_mass":
            law, k = choose_law(c, "behind the load cell", "on the rod")
            return set_parameter(id, law, "m_rod" if k else "m_load", 2.0, 400.0, label="mass")
        case "constant_force":
            law, k = choose_law(c, "behind the load cell", "on the rod")
            return set_parameter(id, law, "F_rod" if k else "F_0", 3.0, 1500.0, direction=random_sign(c), label="F_0")
        case "load_spring":
            if c.K_S > 0.0:
                return scale_parameter("K_S", id, "stiffness off", random_sign(c), 0.01, 0.8)
            return set_parameter(id, "missing", "K_S", 500.0, 6e4)
        case "spring_hardening":
            law, k = choose_law(c, "cubic", "sinh") if c.K_S > 0.0 else ("cubic", 0.0)
            return set_parameter(id, law, "k_3", 2e6, 3e9, hardening_law=k)
        case "backlash":
            return set_parameter(id, "carriage in a play", "width", 2e-5, 1.2 * c.reach)
        case "end_stop":
            law, k = choose_law(c, "linear contact", "stiffening contact")
            return Effect(
                id, law, lambda b, s: b.with_rig(x_stop=c.reach - s, stop_law=k), 2e-5, 0.5 * c.reach,
                lambda b: {"x_stop": b.rig.x_stop},
            )  # fmt: skip
        case "viscosity_warmup":
            law, k = choose_law(c, "exponential", "straight")
            return set_parameter(id, law, "drop", 0.02, 0.7, warm_law=k, warm_time=rng.uniform(6.0, 20.0))
    raise KeyError(id)
