"""A drive without current within a dead band of the command: from dead time of the gate drivers, or set to avoid hum at
standstill.

I = sign(I) max(|I| - I_db, 0). In a steady motion it acts like Coulomb friction K_T I_db on the shaft; when the motor
brakes, current and speed have opposite signs and the two differ.
"""

from ._effect import Effect, EffectParameter


def current(current: float, I_db: float) -> float:
    """The part of the current outside +-I_db."""
    return max(current - I_db, 0.0) + min(current + I_db, 0.0)


effect = Effect(
    name="drive_dead_band",
    place="drive",
    summary="no current for commands within a dead band, and less by the band beyond",
    fingerprint="torque error of constant size with the sign of the current, not of the speed",
    changes={"current": current},
    parameters=(EffectParameter("I_db", "A", "half the width of the band", 0.0, 0.05, 0.0, 5.0, detectable=0.02),),
    source="textbook form of a dead zone",
)
