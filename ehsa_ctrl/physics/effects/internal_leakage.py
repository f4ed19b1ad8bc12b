"""Laminar leakage K_L of pump and piston is not the one believed."""

from ._effect import Effect

effect = Effect(
    name="internal_leakage",
    place="flow",
    summary="laminar leakage other than believed",
    fingerprint="flow error ~ dP",
    symbols={"K_L": 0.0},
    wears={"K_L": 5e-13},
    source="paper, (2)",
)
