"""A constant current on top of the commanded one."""

from collections.abc import Mapping

from ._effect import Effect, EffectParameter


def current(current: float, I_0: float) -> float:
    """I + I_0."""
    return current + I_0


def equivalent_effects(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """The current is known only from its sensor."""
    return {"sensor_bias": "a logged current with a bias acts as an offset of the drive"}


effect = Effect(
    name="current_offset",
    place="drive",
    summary="constant current on top of the commanded one",
    fingerprint="constant torque error; breakaway currents differ by twice the offset, and the rod drifts one way",
    changes={"current": current},
    parameters=(EffectParameter("I_0", "A", "offset", 0.0, 0.1, -2.0, 2.0, detectable=0.02),),
    equivalent_effects=equivalent_effects,
    drifts=True,
    source="definition",
)
