"""The inertia J_M of motor, pump and coupling is not the one believed."""

from ._effect import Effect

effect = Effect(
    name="rotor_inertia",
    place="torque",
    summary="inertia other than believed",
    fingerprint="torque error in proportion to the shaft's acceleration",
    symbols={"J_M": 0.0},
    source="paper, (1)",
)
