"""A constant force acts on the rod: gravity, a hanging load."""

from ._effect import Effect

effect = Effect(
    name="constant_force",
    place="force",
    summary="constant force on the rod",
    fingerprint="constant force error; the rod drifts one way",
    letters=("F_0",),
    source="paper, (5)",
)
