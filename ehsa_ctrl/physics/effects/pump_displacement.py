"""The pump's displacement D is not the one believed."""

from ._effect import Effect

effect = Effect(
    name="pump_displacement",
    place="flow",
    summary="pump displacement other than believed",
    fingerprint="flow error ~ omega, whatever the pressure; also a torque error ~ dP",
    symbols={"D": 0.0},
    source="paper, (2), (3)",
)
