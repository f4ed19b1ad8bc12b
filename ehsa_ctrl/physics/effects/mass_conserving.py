"""Chambers that conserve mass: oil carries the density of the chamber it comes from.

In (12) the pump takes oil out of one chamber at its pressure and puts the same volume into the other, so every
pumped joule raises the pressure level. With rho = rho_0 exp(P/beta), the density that fits a constant bulk modulus,
the flow Q into a chamber at pressure P brings the volume Q exp((P_from - P)/beta), and rho_1 V_1 + rho_2 V_2 stays
constant to rounding.
"""

from math import exp

from ._effect import Effect


def flow_1(Q_1: float, P_1: float, P_2: float, beta: float) -> float:
    """Volume that arrives in chamber 1 [m3/s]: expanded or compressed if it comes from chamber 2."""
    return Q_1 * exp((P_2 - P_1) / beta) if Q_1 > 0.0 else Q_1


def flow_2(Q_2: float, P_1: float, P_2: float, beta: float) -> float:
    """Volume that leaves chamber 2 [m3/s]: negative when it comes from chamber 1."""
    return Q_2 * exp((P_1 - P_2) / beta) if Q_2 < 0.0 else Q_2


effect = Effect(
    name="mass_conserving",
    place="flow",
    summary="oil carries its density from chamber to chamber, so that the pressure level does not drift",
    fingerprint="P_1 + P_2 stays level over hours of work, where (12) lets it climb",
    changes={"Q_1": flow_1, "Q_2": flow_2},
)
