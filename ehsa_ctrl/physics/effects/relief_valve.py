"""Relief valves, from each chamber to the tank or from port to port; section 2 of the paper describes both.

A static valve, whose opening is proportional to the pressure above P_crack and complete P_open_range above it, with
flow by the orifice law Q = opening K_relief sqrt(P). A valve to the tank that closes at a lower pressure than it opens
has `relief_hysteresis` beside.
"""

from math import inf, sqrt

import numpy as np

from ._candidate import (
    PRESSURE_SCALE,
    CandidateEffect,
    DiagnosisContext,
    FreeNumber,
    effect_number,
    from_levels,
    measured,
)
from ._effect import Effect, EffectParameter

#: Lag of the poppet [s], and typical fall of the pressure at which it closes, in P_crack. Engineering judgement:
#: direct-acting valves close at 85 to 95 % of the cracking pressure, within some milliseconds.
POPPET, RESEAT = 3e-3, 0.07
#: Largest flow over root of pressure [m3/(s Pa^0.5)] that is searched, that of a bore of 21 mm. With more, the pressure
#: is clamped as well, and the equations get so stiff that a simulation takes a hundred times as long.
WIDEST = 1e-5


def relief_flow(P: float, P_crack: float, P_open_range: float, K_relief: float) -> float:
    """Flow to the tank [m3/s], zero up to P_crack."""
    opening = min(max(P - P_crack, 0.0) / P_open_range, 1.0)
    return K_relief * opening * sqrt(max(P, 0.0))


def crossing(P_1: float, P_2: float, P_cross: float, P_open_range: float, K_relief: float) -> float:
    """Flow from port 1 to port 2 [m3/s] through a valve that opens at the difference P_cross in either direction."""
    forth = min(max(P_1 - P_2 - P_cross, 0.0) / P_open_range, 1.0)
    back = min(max(P_2 - P_1 - P_cross, 0.0) / P_open_range, 1.0)
    return K_relief * (forth - back) * sqrt(abs(P_1 - P_2))


def flow_1(
    Q_T1: float, P_1: float, P_2: float, P_crack: float, P_cross: float, P_open_range: float, K_relief: float
) -> float:
    """Chamber 1 loses the flow of its valve and the flow to port 2."""
    lost = relief_flow(P_1, P_crack, P_open_range, K_relief)
    return Q_T1 - (lost + crossing(P_1, P_2, P_cross, P_open_range, K_relief))


def flow_2(
    Q_T2: float, P_1: float, P_2: float, P_crack: float, P_cross: float, P_open_range: float, K_relief: float
) -> float:
    """Chamber 2 loses the flow of its valve and gains the flow from port 1."""
    lost = relief_flow(P_2, P_crack, P_open_range, K_relief)
    return Q_T2 - (lost - crossing(P_1, P_2, P_cross, P_open_range, K_relief))


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A level somewhat below the highest pressure, or the highest difference; with the flow gain nominal or free.

    Under the level of a valve to the tank, with hysteresis too.
    """
    pressures = measured(context, "P_1", "P_2")
    high = max((float(np.quantile(p, 0.998)) for p in pressures), default=2e7)
    low = context.value("P_0")
    levels = [low + share * (high - low) for share in (0.95, 0.8, 0.6)]
    crack = effect_number(effect, context, "P_crack", max(0.05 * (high - low), PRESSURE_SCALE))
    gain = effect_number(effect, context, "K_relief", 0.3 * context.value("K_relief"))
    found = [from_levels(effect, crack, levels), from_levels(effect, crack, levels[:2], gain)]
    if context.simulated("P_hyst"):
        fall = FreeNumber("P_hyst", RESEAT * high, max(0.02 * high, PRESSURE_SCALE), 0.0, 0.5 * high)
        found.append(from_levels(effect, crack, levels[:2], fall, gain))
    if len(pressures) == 2:
        top = float(np.quantile(np.abs(pressures[0] - pressures[1]), 0.998))
        levels = [share * top for share in (0.95, 0.8, 0.6)]
        cross = effect_number(effect, context, "P_cross", max(0.05 * top, PRESSURE_SCALE))
        found += [from_levels(effect, cross, levels), from_levels(effect, cross, levels[:2], gain)]
    return found


effect = Effect(
    name="relief_valve",
    place="flow",
    summary="relief valves to the tank or across the ports",
    fingerprint="the pressure stops rising, while the pump turns faster than the rod's motion needs",
    changes={"Q_T1": flow_1, "Q_T2": flow_2},
    parameters=(
        EffectParameter("P_crack", "Pa", "cracking pressure, gauge", inf, 210e5, 0.0, source="datasheet"),
        EffectParameter("P_cross", "Pa", "cracking difference between the ports", inf, inf, 0.0),
        EffectParameter("P_open_range", "Pa", "rise from cracking to fully open", 10e5, 10e5, 1e4),
        EffectParameter(
            "K_relief", "m3/(s Pa^0.5)", "flow over root of pressure, fully open", 1e-7, 1e-7, 0.0, search=(0.0, WIDEST)
        ),
    ),
    candidates=candidates,
)
