"""All ids of the catalogue: drawing one, and the balance that it changes."""

from __future__ import annotations

from cause import Conditions, Effect
from effects_flow import draw_flow
from effects_force import draw_load, draw_rod
from effects_outside import OUTSIDE
from effects_outside import PLACES as OUTSIDE_PLACES
from effects_sensor import draw_sensor
from effects_torque import draw_torque

#: Ids of the contract, in its order. Random draws, pairs and effects with parameter errors use these.
CONTRACT = (
    "torque_constant", "torque_saturation", "rotor_inertia", "motor_friction", "motor_viscous_friction",
    "torque_ripple", "pump_torque_loss", "current_offset", "drive_lag", "drive_delay", "pump_displacement",
    "internal_leakage", "orifice_leakage", "external_leakage", "bulk_modulus", "entrained_air",
    "chamber_volume_variation", "relief_valve", "anti_cavitation", "unequal_areas", "rod_friction",
    "rod_viscous_friction", "load_dependent_friction", "asymmetric_friction", "position_dependent_friction",
    "presliding", "line_pressure_drop", "payload_mass", "constant_force", "load_spring", "spring_hardening",
    "backlash", "end_stop", "viscosity_warmup", "sensor_bias", "sensor_scale", "sensor_delay", "sensor_filter",
)  # fmt: skip
#: Ids beyond the contract, and the balance of each.
BEYOND = {
    "windage": "torque", "drive_dead_band": "drive", "pump_dead_zone": "flow", "filling_loss": "flow",
    "pressure_dependent_displacement": "flow",
}  # fmt: skip
#: Ids that are drawn in one form only, by `effects_other_forms`, and the balance of each.
ONE_FORM = {"hose_wall": "flow"}
#: Ids that the families of single effects draw in turn.
DRAWN = (*CONTRACT, *BEYOND)
#: All ids: the index of scores and of the confusion matrix.
IDS = (*DRAWN, *ONE_FORM)
_PLACES = (("torque", 7), ("drive", 10), ("flow", 20), ("force", 34), ("sensor", 38))


def draw(id: str, c: Conditions) -> Effect:
    """One effect with a law, a sign and, where it has one, a channel."""
    if id in BEYOND:
        return draw_torque(c, id) if BEYOND[id] in ("torque", "drive") else draw_flow(c, id)
    families = ((draw_torque, 10), (draw_flow, 20), (draw_rod, 27), (draw_load, 34), (draw_sensor, 38))
    family = next(f for f, end in families if IDS.index(id) < end)
    return family(c, id)


def place_of(id: str, law: str) -> list[str]:
    """Balances that the cause changes."""
    if id == OUTSIDE:
        return [OUTSIDE_PLACES[law]]
    if id in (*BEYOND, *ONE_FORM):
        return [{**BEYOND, **ONE_FORM}[id]]
    if id == "viscosity_warmup":
        return ["torque", "force"]
    return [next(place for place, end in _PLACES if IDS.index(id) < end)]
