"""Ids that no log can tell apart: naming one of them names the cause."""

from __future__ import annotations

Names = tuple[tuple[str, str | None], ...]


def equivalents(id: str, channel: str | None = None, *, more_drag: bool = True, laminar: bool = True) -> Names:
    """Other (id, channel) that describe the same change.

    more_drag: a rod's viscous friction that is larger than nominal, as a line adds drag and takes none away.
    laminar: a line whose loss is proportional to the flow.
    """
    if (id, channel) == ("sensor_scale", "current"):
        return (("torque_constant", None),)
    if (id, channel) == ("sensor_bias", "current"):
        return (("current_offset", None),)
    if id == "rod_viscous_friction" and not more_drag:
        return ()
    if id == "line_pressure_drop" and not laminar:
        # Between pump ports and chambers the loss acts as a force v |v| on the rod.
        return (("rod_drag", None),)
    return _SAME.get(id, ())


_SAME: dict[str, Names] = {
    "torque_constant": (("sensor_scale", "current"),),
    "current_offset": (("sensor_bias", "current"),),
    "rod_viscous_friction": (("line_pressure_drop", None),),
    "line_pressure_drop": (("rod_viscous_friction", None),),
    # Compressibility acts as V / beta; the free stroke part is small against V_10 and V_20.
    "bulk_modulus": (("chamber_volume_variation", None),),
}
