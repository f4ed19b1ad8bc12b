"""Free air in the oil, which softens it at low pressure.

Oil of bulk modulus beta contains a volume share a of air at atmospheric pressure p_a, which is compressed
polytropically with exponent n. With r = (p_a / p)^(1/n), p absolute, the mixture has
1/beta_mix = (1/beta + a r / (n p)) / (1 + a r), so the pressure rates of (11) are multiplied by
beta_mix / beta = (1 + a r) / (1 + a r beta / (n p)).
"""

from ._candidate import CandidateEffect, DiagnosisContext, effect_number
from ._effect import Effect, EffectParameter

P_ATM = 101325.0


def softening(P: float, beta: float, air_fraction: float, n_air: float) -> float:
    """beta_mix / beta at gauge pressure P; constant below a hundredth of an atmosphere, to stay finite."""
    p = max(P + P_ATM, 0.01 * P_ATM)
    share = air_fraction * (P_ATM / p) ** (1.0 / n_air)
    return (1.0 + share) / (1.0 + share * (beta / (n_air * p)))


def rate_1(P_1_dot: float, P_1: float, beta: float, air_fraction: float, n_air: float) -> float:
    """The pressure of chamber 1 changes more slowly."""
    return P_1_dot * softening(P_1, beta, air_fraction, n_air)


def rate_2(P_2_dot: float, P_2: float, beta: float, air_fraction: float, n_air: float) -> float:
    """The pressure of chamber 2 changes more slowly."""
    return P_2_dot * softening(P_2, beta, air_fraction, n_air)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Little and much air. Slow changes are isothermal, fast ones adiabatic, so the exponent is free."""
    air, exponent = effect_number(effect, context, "air_fraction", 0.003), effect_number(effect, context, "n_air", 0.1)
    return [CandidateEffect(effect, (air, exponent), tuple((share, exponent.nominal) for share in (0.003, 0.02)))]


effect = Effect(
    name="entrained_air",
    place="flow",
    summary="free air makes the oil soft at low pressure",
    fingerprint="pressures change slowly when low and fast when high; the low chamber's changes are the smaller ones",
    changes={"P_1_dot": rate_1, "P_2_dot": rate_2},
    parameters=(
        EffectParameter("air_fraction", "1", "volume share of free air at 1 atm", 0.0, 0.01, 0.0, 0.3),
        EffectParameter("n_air", "1", "polytropic exponent", 1.2, 1.2, 1.0, 1.4),
    ),
    candidates=candidates,
    source="volume balance of oil and polytropic air, derived here",
)
