"""Chambers that conserve mass: oil has the density of the chamber that it comes from.

In (12) the pump moves equal volumes between chambers of different pressure, so all pumping work raises the mean
pressure. With rho = rho_0 exp(P/beta), the density for a constant bulk modulus, a flow Q into a chamber at pressure P
brings the volume Q exp((P_from - P)/beta), and rho_1 V_1 + rho_2 V_2 is constant to rounding.
"""

from math import exp

from ._effect import Effect


def flow_1(Q_1: float, P_1: float, P_2: float, beta: float) -> float:
    """Volume flow into chamber 1 [m3/s]: oil from chamber 2 expands or is compressed."""
    return Q_1 * exp((P_2 - P_1) / beta) if Q_1 > 0.0 else Q_1


def flow_2(Q_2: float, P_1: float, P_2: float, beta: float) -> float:
    """Volume flow out of chamber 2 [m3/s], negative for oil from chamber 1."""
    return Q_2 * exp((P_1 - P_2) / beta) if Q_2 < 0.0 else Q_2


effect = Effect(
    name="mass_conserving",
    place="flow",
    summary="mass instead of volume is conserved, so that the mean pressure does not drift",
    fingerprint="P_1 + P_2 stays constant over hours of work, while it rises in (12)",
    changes={"Q_1": flow_1, "Q_2": flow_2},
)
