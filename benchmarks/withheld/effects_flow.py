"""Effects in the chambers' flow balances."""

from __future__ import annotations

import numpy as np
from cause import Bench, Conditions, Effect, choose_law, random_sign, scale_parameter, set_parameter
from equivalent_ids import equivalents


def draw_flow(c: Conditions, id: str) -> Effect:
    match id:
        case "pump_displacement":
            return scale_parameter("D", id, "constant", random_sign(c), 0.005, 0.15)
        case "internal_leakage":

            def leak(b: Bench, s: float) -> Bench:
                return b.with_rig(K_L=b.rig.K_L + s)

            return Effect(id, "laminar", leak, 2e-13, 5e-11, lambda b: {"K_L": b.rig.K_L})
        case "orifice_leakage":
            law, k = choose_law(c, "root", "laminar and turbulent in series")
            return set_parameter(id, law, "K_t", 1e-10, 3e-8, orifice_law=k)
        case "external_leakage":
            share = c.rng.uniform(0.8, 1.25)

            def out(b: Bench, s: float) -> Bench:
                return b.with_rig(K_e1=s, K_e2=s * share)

            return Effect(
                id, "laminar, not quite alike", out, 3e-16, 3e-12, lambda b: {"K_e": 0.5 * (b.rig.K_e1 + b.rig.K_e2)}
            )
        case "bulk_modulus":
            return scale_parameter(
                "beta", id, "constant", float(c.rng.choice([-1.0, -1.0, 1.0])), 0.03, 1.8, also=equivalents(id)
            )
        case "entrained_air":
            law, k = choose_law(c, "isothermal", "polytropic", "polytropic, dissolving")
            return set_parameter(id, law, "air", 3e-4, 0.08, label="air_fraction", air_law=k)
        case "chamber_volume_variation":
            law, _ = choose_law(c, "one more, one less", "one chamber", "the stroke counts more")
            way, front = random_sign(c), bool(c.rng.integers(2))

            def volumes(b: Bench, s: float) -> Bench:
                V1, V2 = b.rig.V_10, b.rig.V_20
                up = float(np.exp(way * s))
                if law == "one chamber":
                    return b.with_rig(**({"V_10": V1 * up} if front else {"V_20": V2 * up}))
                if law == "one more, one less":
                    return b.with_rig(V_10=V1 * up, V_20=V2 / up)
                return b.with_rig(stroke_term=float(np.exp(3.0 * s)))

            def values(b: Bench) -> dict[str, float]:
                # More stroke volume is no value of V_10 and V_20.
                return {} if law == "the stroke counts more" else {"V_10": b.rig.V_10, "V_20": b.rig.V_20}

            return Effect(id, law, volumes, 0.02, 0.9, values)
        case "relief_valve":
            law, k = choose_law(c, "to the tank", "across the ports")
            peak = float(np.max(np.abs(c.samples[:, 1] - c.samples[:, 2])) if k else np.max(c.samples[:, 1:3]))

            def crack(b: Bench, s: float) -> Bench:
                return b.with_rig(P_crack=peak - s, relief_law=k)

            return Effect(id, law, crack, 5e3, 0.8 * peak if k else 9e5, lambda b: {"P_crack": b.rig.P_crack})
        case "anti_cavitation":
            low = float(np.min(c.samples[:, 1:3]))

            def fill(b: Bench, s: float) -> Bench:
                return b.with_rig(P_open=low + s)

            return Effect(id, "straight check valve", fill, 5e3, 8e5, lambda b: {"P_open": b.rig.P_open})
        case "unequal_areas":
            law, k = choose_law(c, "half a side", "front side")
            return set_parameter(id, law, "dA", 3e-4, 0.06, direction=random_sign(c), area_law=k)
        case "pump_dead_zone":
            return set_parameter(id, "dead zone", "pump_dead_zone", 0.5, 40.0, label="w_d")
        case "filling_loss":
            return set_parameter(id, "square of the speed", "filling_loss", 0.01, 0.4, label="k_f")
        case "pressure_dependent_displacement":

            def yields(b: Bench, s: float) -> Bench:
                return b.with_rig(displacement_pressure=s)

            # The rig's number is per 10 bar.
            return Effect(id, "straight", yields, 0.003, 0.3, lambda b: {"k_D": 1e-6 * b.rig.displacement_pressure})
    raise KeyError(id)
