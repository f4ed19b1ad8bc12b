"""A dead time of the drive: the current acts later than commanded."""

from math import inf

from ._effect import Effect, EffectParameter

effect = Effect(
    name="drive_delay",
    place="drive",
    summary="dead time between the commanded and the acting current",
    fingerprint="all channels lag the current by the same time",
    parameters=(EffectParameter("T_d", "s", "dead time", 0.0, 4e-3, 0.0, inf, detectable=1e-3, search=(0.0, 0.06)),),
    delays=True,
    source="definition",
)
