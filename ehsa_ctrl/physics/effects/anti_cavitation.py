"""Anti-cavitation check valves from the tank into each chamber: the safety circuit of section 2 of the paper.

A chamber whose pressure falls below P_open (tank pressure less the spring of the check valve; gauge) is filled
from the tank by the orifice law, made linear within P_lam around zero so that the slope stays finite.
"""

from dataclasses import replace
from math import inf, sqrt

import numpy as np

from ._candidate import PRESSURE_SCALE, CandidateEffect, DiagnosisContext, effect_number, from_levels, measured
from ._effect import Effect, EffectParameter


def check_flow(P: float, P_open: float, K_check: float, P_lam: float) -> float:
    """Flow from the tank [m3/s], zero above P_open: K dP / (dP^2 + P_lam^2)^(1/4)."""
    drop = max(P_open - P, 0.0)
    return K_check * drop / sqrt(sqrt(drop * drop + P_lam * P_lam))


def flow_1(Q_T1: float, P_1: float, P_open: float, K_check: float, P_lam: float) -> float:
    """Chamber 1 gains the valve's flow."""
    return Q_T1 + check_flow(P_1, P_open, K_check, P_lam)


def flow_2(Q_T2: float, P_2: float, P_open: float, K_check: float, P_lam: float) -> float:
    """Chamber 2 gains the valve's flow."""
    return Q_T2 + check_flow(P_2, P_open, K_check, P_lam)


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A level above the lowest pressure; none if that is not below the pressure at rest: the valve stayed shut."""
    pressures = measured(context, "P_1", "P_2")
    low = min((float(np.quantile(p, 0.002)) for p in pressures), default=0.0)
    top = context.value("P_0")
    opening = replace(effect_number(effect, context, "P_open", max(0.05 * (top - low), PRESSURE_SCALE)), lower=-1e5)
    levels = [low + share * (top - low) for share in (0.1, 0.3, 0.6)] if low < top else []
    found = from_levels(effect, opening, levels)
    return [found] if found.starts else []


effect = Effect(
    name="anti_cavitation",
    place="flow",
    summary="check valves that fill a chamber from the tank before it cavitates",
    fingerprint="the low side stays at tank pressure, and P_1 + P_2 rises with each move",
    changes={"Q_T1": flow_1, "Q_T2": flow_2},
    parameters=(
        EffectParameter("P_open", "Pa", "chamber pressure at which the valve opens, gauge", -inf, -0.1e5, -inf),
        EffectParameter("K_check", "m3/(s Pa^0.5)", "flow over root of pressure drop", 3e-6, 3e-6, 0.0),
        EffectParameter("P_lam", "Pa", "drop below which the flow is linear", 1e3, 1e3, 1.0),
    ),
    candidates=candidates,
)
