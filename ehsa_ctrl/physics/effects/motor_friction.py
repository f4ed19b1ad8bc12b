"""Dry friction of motor and pump, A_FM and C_FM of (8), is not the one believed, or missing."""

from ._effect import Effect

effect = Effect(
    name="motor_friction",
    place="torque",
    summary="dry friction of the shaft off or missing",
    fingerprint="torque error ~ sign(omega), and more at standstill",
    symbols={"A_FM": 0.1, "C_FM": 0.02},
    groups=(("A_FM", "C_FM"),),
    also=("tau_FM",),
    from_balances=True,
    source="paper, (8), (9)",
)
