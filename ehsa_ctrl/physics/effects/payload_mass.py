"""More mass moves with the rod than believed: M, or m_L behind the load cell."""

from ._effect import Effect

effect = Effect(
    name="payload_mass",
    place="force",
    summary="more mass at the rod than believed",
    fingerprint="force error ~ rod acceleration; hardly any in the shaft's speed",
    symbols={"M": 0.0, "m_L": 20.0},
    groups=(("M",), ("m_L",)),
    source="paper, (5)",
)
