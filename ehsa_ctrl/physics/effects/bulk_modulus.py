"""The oil's bulk modulus beta is not the one believed."""

from ._effect import Effect

effect = Effect(
    name="bulk_modulus",
    place="flow",
    summary="bulk modulus other than believed",
    fingerprint="flow errors ~ pressure rates; from V it differs only by the stroke",
    symbols={"beta": 0.0},
    source="paper, (4)",
)
