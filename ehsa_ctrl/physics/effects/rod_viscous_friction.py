"""Viscous friction B_FR of the rod is not the one believed."""

from ._effect import Effect

effect = Effect(
    name="rod_viscous_friction",
    place="force",
    summary="viscous friction of the rod other than believed",
    fingerprint="force error ~ v",
    letters=("B_FR",),
    source="paper, (10)",
)
