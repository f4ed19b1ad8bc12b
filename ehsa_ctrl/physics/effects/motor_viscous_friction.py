"""Viscous friction B_FM of motor and pump is not the one believed."""

from ._effect import Effect

effect = Effect(
    name="motor_viscous_friction",
    place="torque",
    summary="viscous friction of the shaft other than believed",
    fingerprint="torque error ~ omega",
    symbols={"B_FM": 1e-4},
    source="paper, (9)",
)
