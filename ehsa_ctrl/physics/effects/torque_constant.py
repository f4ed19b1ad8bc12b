"""The torque constant K_T is not the one believed; a drive's gain is the same thing."""

from ._effect import Effect

effect = Effect(
    name="torque_constant",
    place="torque",
    summary="torque constant other than believed",
    fingerprint="torque error in proportion to the current",
    letters=("K_T",),
    source="paper, (1)",
)
