"""The load's spring K_S is not the one believed, or missing."""

from ._effect import Effect

effect = Effect(
    name="load_spring",
    place="force",
    summary="spring of the load off or missing",
    fingerprint="force error ~ position",
    symbols={"K_S": 2e3},
    source="paper, (5)",
)
