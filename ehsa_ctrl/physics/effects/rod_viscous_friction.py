"""Viscous friction B_FR of the rod is not the one believed."""

from collections.abc import Mapping

from ._effect import Effect


def same(found: Mapping[str, float], plant: Mapping[str, float], flow: float) -> dict[str, str]:
    """More of it may be a laminar drop in the lines."""
    if found.get("B_FR", 0.0) <= plant["B_FR"]:
        return {}
    return {"line_pressure_drop": "a laminar drop between pump ports and chambers acts as viscous rod friction"}


effect = Effect(
    name="rod_viscous_friction",
    place="force",
    summary="viscous friction of the rod other than believed",
    fingerprint="force error ~ v",
    symbols={"B_FR": 500.0},
    from_balances=True,
    same=same,
    source="paper, (10)",
)
