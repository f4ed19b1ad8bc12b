"""Viscoelastic walls of hoses: they give way to the pressure late, behind a first-order lag.

Each wall takes up the volume C_h P_W, where P_W follows the rise of the pressure above P_0 with the time constant
tau_h. A wall that follows at once acts as a lower bulk modulus.
"""

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number
from ._effect import Effect, EffectParameter
from ._late_pressure import late_pressures

#: Typical time constant of a wall [s]. Engineering judgement.
TAU_H = 0.1


def wall_rate_1(P_1: float, P_W1: float, P_0: float, C_h: float, tau_h: float) -> float:
    """Rate of P_W at port 1; zero without the effect."""
    return 0.0 if C_h == 0.0 else (P_1 - P_0 - P_W1) / tau_h


def wall_rate_2(P_2: float, P_W2: float, P_0: float, C_h: float, tau_h: float) -> float:
    """The same at port 2."""
    return 0.0 if C_h == 0.0 else (P_2 - P_0 - P_W2) / tau_h


def flow_1(Q_1: float, P_1: float, P_W1: float, P_0: float, C_h: float, tau_h: float) -> float:
    """Chamber 1 gets what the pump delivers less C_h dP_W/dt, which the wall takes up."""
    return Q_1 - C_h * wall_rate_1(P_1, P_W1, P_0, C_h, tau_h)


def flow_2(Q_2: float, P_2: float, P_W2: float, P_0: float, C_h: float, tau_h: float) -> float:
    """Chamber 2 loses what goes to the pump and into the wall."""
    return Q_2 + C_h * wall_rate_2(P_2, P_W2, P_0, C_h, tau_h)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A fast and a slow wall."""
    wall = (effect_number(effect, context, "C_h", 1e-13), FreeNumber("tau_h", TAU_H, 0.03, 0.01, 5.0))
    return [CandidateEffect(effect, wall, ((5e-13, TAU_H), (5e-13, 0.5)))]


effect = Effect(
    name="hose_wall",
    place="flow",
    summary="viscoelastic walls of hoses, which follow the pressure late",
    fingerprint="after a step the pressures go on changing: flow error ~ a lagged rate of the pressure",
    changes={"Q_1": flow_1, "Q_2": flow_2},
    parameters=(
        EffectParameter("C_h", "m3/Pa", "volume per pressure, each wall", 0.0, 1e-12, 0.0, detectable=1e-13),
        EffectParameter("tau_h", "s", "time constant of the wall", TAU_H, TAU_H, 1e-3, 1e3, shape=True),
    ),
    states=late_pressures("P_W", "tau_h", TAU_H),
    adds={"P_W1_dot": wall_rate_1, "P_W2_dot": wall_rate_2},
    candidates=candidates,
    source="Kelvin-Voigt element, as in textbooks of viscoelasticity",
)
