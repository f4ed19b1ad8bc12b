"""A dead time of the drive: the current acts later than it was asked for."""

from math import inf

from ._effect import Effect, EffectParameter

effect = Effect(
    name="drive_delay",
    place="drive",
    summary="dead time between the current asked for and the acting one",
    fingerprint="all channels are late against the current by the same time",
    parameters=(EffectParameter("T_d", "s", "dead time", 0.0, 4e-3, 0.0, inf, felt=1e-3, search=(0.0, 0.06)),),
    delays=True,
    source="definition",
)
