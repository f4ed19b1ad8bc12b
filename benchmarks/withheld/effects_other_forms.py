"""Effects of the catalogue under a law of another form: right by name, without a size that could be compared."""

from __future__ import annotations

from math import pi

from cause import Bench, Conditions, Effect, random_sign, set_parameter
from effects import draw as draw_effect
from equivalent_ids import Names, equivalents

#: Ids that have one, and the law.
OTHER_FORMS = {
    "torque_saturation": "hard knee", "torque_ripple": "two orders", "pump_torque_loss": "with the speed",
    "drive_lag": "second order", "orifice_leakage": "power 0.7", "entrained_air": "dissolving late",
    "relief_valve": "hysteresis", "rod_friction": "Maxwell slip", "position_dependent_friction": "waves",
    "line_pressure_drop": "Blasius", "end_stop": "cushion", "viscosity_warmup": "with the losses", "hose_wall": "late",
}  # fmt: skip


def draw_other_form(c: Conditions, id: str) -> Effect:
    """One effect; its range of sizes is that of the catalogue's form unless the law has a scale of its own."""
    law, rng = OTHER_FORMS[id], c.rng

    def one(name: str, low: float, high: float, *, also: Names = (), **fixed: float) -> Effect:
        effect = set_parameter(id, law, name, low, high, also=also, **fixed)
        return Effect(id, law, effect.apply, low, high, lambda b: {}, counts_as=effect.counts_as)

    match id:
        case "torque_saturation":
            return one("k_sat", 0.05, 0.6, saturation_law=3.0)
        case "torque_ripple":
            first, second = rng.choice([1.0, 2.0, 3.0, 4.0, 5.0, 7.0], 2, replace=False)
            return one(
                "T_c", 0.03, 0.8, ripple_order=float(first), ripple_phase=rng.uniform(0.0, 2.0 * pi),
                ripple_second=float(second), ripple_share=rng.uniform(0.4, 0.9),
            )  # fmt: skip
        case "pump_torque_loss":
            return one("c_f", 0.005, 0.3, loss_law=2.0)
        case "drive_lag":
            return one("tau_I", 3e-4, 0.02, lag_law=2.0)
        case "orifice_leakage":
            return one("K_t", 1e-10, 3e-8, orifice_law=2.0)
        case "entrained_air":
            return one("air", 3e-4, 0.08, air_law=3.0)
        case "relief_valve":
            peak = float(c.samples[:, 1:3].max())

            def crack(b: Bench, s: float) -> Bench:
                return b.with_rig(P_crack=peak - s, relief_law=2.0)

            return Effect(id, law, crack, 5e3, 9e5, lambda b: {})
        case "rod_friction":
            way, bristle = random_sign(c), rng.uniform(1e-8, 6e-8)

            def slip(b: Bench, s: float) -> Bench:
                level = b.rig.A_FR * (1.0 + way * s)
                return b.with_rig(A_FR=level, bristle=bristle, bristle_law=2.0)

            # Sliders are elastic before they slip.
            return Effect(id, law, slip, 0.01, 0.5, lambda b: {}, counts_as=(("presliding", None),))
        case "position_dependent_friction":
            width = rng.uniform(0.15, 0.4) * c.reach
            return one("h", 0.03, 3.0, bump_law=3.0, bump_place=rng.uniform(-0.5, 0.5) * c.reach, bump_width=width)
        case "line_pressure_drop":
            return one("R_turb", 3e10, 5e13, also=equivalents(id, laminar=False), line_exponent=1.75)
        case "end_stop":
            stop = draw_effect(id, c)

            def cushion(b: Bench, s: float) -> Bench:
                return stop.apply(b, s).with_rig(stop_law=2.0)

            return Effect(id, law, cushion, stop.smallest, stop.largest, lambda b: {})
        case "hose_wall":
            return one("hose", 3e-14, 2e-11, hose_time=rng.uniform(0.05, 0.5))
        case "viscosity_warmup":
            return one("drop", 0.02, 0.7, warm_law=2.0, warm_time=rng.uniform(6.0, 20.0))
    raise KeyError(id)
