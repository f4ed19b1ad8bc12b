"""Free air in the oil, which softens it at low pressure.

Oil of bulk modulus beta contains a volume share a of air at atmospheric pressure p_a, which is compressed
polytropically with exponent n. With r = (p_a / p)^(1/n), p absolute, the mixture has
1/beta_mix = (1/beta + a r / (n p)) / (1 + a r), with beta_mix / beta = (1 + a r) / (1 + a r beta / (n p)). A chamber
counts as the larger volume of pure oil that yields as much, V beta / beta_mix, in the pressure rates of (11) and in the
flow balance.

Air dissolves in proportion to the pressure (Henry's law), but late: with P_H, the rise of the pressure above P_0 behind
a lag tau_diss, the free share is a (1 - P_H / P_diss). An infinite P_diss keeps all air free.
"""

from math import inf

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number
from ._effect import Effect, EffectParameter
from ._late_pressure import late_pressures

P_ATM = 101325.0
#: Typical lag of the dissolution [s], and bounds of the share of a that is free. Engineering judgement.
TAU_DISS, LEAST_FREE, MOST_FREE = 2.0, 0.02, 2.0


def softening(P: float, beta: float, air_fraction: float, n_air: float) -> float:
    """beta_mix / beta at gauge pressure P; constant below a hundredth of an atmosphere, to stay finite."""
    p = max(P + P_ATM, 0.01 * P_ATM)
    share = air_fraction * (P_ATM / p) ** (1.0 / n_air)
    return (1.0 + share) / (1.0 + share * (beta / (n_air * p)))


def free_air(air_fraction: float, P_H: float, P_diss: float) -> float:
    """Volume share of the air that is not dissolved, at 1 atm."""
    return air_fraction * min(max(1.0 - P_H / P_diss, LEAST_FREE), MOST_FREE)


def volume_1(
    V_1: float, P_1: float, P_H1: float, beta: float, air_fraction: float, n_air: float, P_diss: float
) -> float:
    """Volume of oil that yields like chamber 1 with its air [m3]."""
    return V_1 / softening(P_1, beta, free_air(air_fraction, P_H1, P_diss), n_air)


def volume_2(
    V_2: float, P_2: float, P_H2: float, beta: float, air_fraction: float, n_air: float, P_diss: float
) -> float:
    """The same for chamber 2."""
    return V_2 / softening(P_2, beta, free_air(air_fraction, P_H2, P_diss), n_air)


def dissolving_1(P_1: float, P_H1: float, P_0: float, air_fraction: float, P_diss: float, tau_diss: float) -> float:
    """Rate of P_H in chamber 1; zero without air, or if none dissolves."""
    return 0.0 if air_fraction == 0.0 or P_diss == inf else (P_1 - P_0 - P_H1) / tau_diss


def dissolving_2(P_2: float, P_H2: float, P_0: float, air_fraction: float, P_diss: float, tau_diss: float) -> float:
    """The same in chamber 2."""
    return 0.0 if air_fraction == 0.0 or P_diss == inf else (P_2 - P_0 - P_H2) / tau_diss


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Little and much air. Slow changes are isothermal, fast ones adiabatic, so the exponent is free.

    With air that dissolves, the exponent keeps its value: a log can't tell all of them.
    """
    air, exponent = effect_number(effect, context, "air_fraction", 0.003), effect_number(effect, context, "n_air", 0.1)
    dissolving = (air, FreeNumber("P_diss", 30e5, 3e5, 5e5, 1e9), FreeNumber("tau_diss", TAU_DISS, 0.5, 0.1, 60.0))
    return [
        CandidateEffect(effect, (air, exponent), tuple((share, exponent.nominal) for share in (0.003, 0.02))),
        CandidateEffect(effect, dissolving, ((0.01, 30e5, TAU_DISS),)),
    ]


effect = Effect(
    name="entrained_air",
    place="flow",
    summary="free air makes the oil soft at low pressure",
    fingerprint="pressures change slowly when low and fast when high; the low chamber's changes are the smaller ones",
    changes={"V_1": volume_1, "V_2": volume_2},
    parameters=(
        EffectParameter("air_fraction", "1", "volume share of free air at 1 atm", 0.0, 0.01, 0.0, 0.3),
        EffectParameter("n_air", "1", "polytropic exponent", 1.2, 1.2, 1.0, 1.4),
        EffectParameter("P_diss", "Pa", "rise at which all air dissolves; infinite: none", inf, inf, 1e5, shape=True),
        EffectParameter("tau_diss", "s", "lag of the dissolution", TAU_DISS, TAU_DISS, 0.01, 1e4, shape=True),
    ),
    states=late_pressures("P_H", "tau_diss", TAU_DISS),
    adds={"P_H1_dot": dissolving_1, "P_H2_dot": dissolving_2},
    candidates=candidates,
    source="volume balance of oil and polytropic air, derived here; Henry's law with a first-order lag",
)
