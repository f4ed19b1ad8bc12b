"""Effects that no log of these channels can tell apart, whatever it excites."""

from __future__ import annotations

from collections.abc import Mapping

from ..plant.plant import Plant

#: A turbulent part of a line's pressure drop below this share of the whole makes it as good as laminar.
LAMINAR = 0.1


def same_in_principle(
    id: str, channel: str | None, values: Mapping[str, float], plant: Plant, flow: float
) -> dict[str, str]:
    """Ids that are the same as this one on any log, and why.

    values: the numbers that were found; flow: the largest flow A v through the lines [m3/s].
    """
    if plant.structure.chambers is None:
        return {}
    if id == "torque_constant":
        return {"sensor_scale": "a logged current that is scaled acts as another torque constant"}
    if id == "current_offset":
        return {"sensor_bias": "a logged current with a bias acts as an offset of the drive"}
    if id == "rod_viscous_friction" and values.get("B_FR", 0.0) > plant["B_FR"]:
        return {"line_pressure_drop": "a laminar drop between pump ports and chambers acts as viscous rod friction"}
    if id == "line_pressure_drop":
        laminar, turbulent = values.get("R_lam", 0.0), values.get("R_turb", 0.0) * flow
        if turbulent < LAMINAR * (laminar + turbulent):
            return {"rod_viscous_friction": "a laminar drop between pump ports and chambers acts as viscous friction"}
    return {}
