"""The load's spring grows stiffer with the way: k_3 x^3."""

from ._effect import Effect

effect = Effect(
    name="spring_hardening",
    place="force",
    summary="spring of the load hardens",
    fingerprint="force error ~ cube of the position",
    symbols={"k_3": 2e6},
    source="paper, (5)",
)
