"""The torque constant K_T is not the one believed; a drive's gain is the same thing."""

from collections.abc import Mapping

from ._effect import Effect


def same(found: Mapping[str, float], plant: Mapping[str, float], flow: float) -> dict[str, str]:
    """The current is known from its sensor alone."""
    return {"sensor_scale": "a logged current that is scaled acts as another torque constant"}


effect = Effect(
    name="torque_constant",
    place="torque",
    summary="torque constant other than believed",
    fingerprint="torque error in proportion to the current",
    symbols={"K_T": 0.0},
    same=same,
    source="paper, (1)",
)
