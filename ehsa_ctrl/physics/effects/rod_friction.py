"""Dry friction of the rod, A_FR and C_FR of (8), is not the one believed, or missing."""

from ._effect import Effect

effect = Effect(
    name="rod_friction",
    place="force",
    summary="dry friction of the rod off or missing",
    fingerprint="force error ~ sign(v), and more at breakaway",
    symbols={"A_FR": 100.0, "C_FR": 50.0},
    groups=(("A_FR", "C_FR"),),
    also=("tau_FR",),
    from_balances=True,
    source="paper, (8), (10)",
)
