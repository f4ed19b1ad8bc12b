"""Presliding: before it slides, the rod gives elastically by some micrometres, the LuGre law instead of (8)."""

from ._effect import Effect

effect = Effect(
    name="presliding",
    place="force",
    summary="elastic motion of the rod before it slides (LuGre)",
    fingerprint="loops of force over position at reversals; the resting rod moves in proportion to the force",
    rod_friction="lugre",
    source="Canudas de Wit et al. 1995, see physics/friction/lugre.py",
)
