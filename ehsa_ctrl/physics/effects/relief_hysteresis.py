"""Hysteresis of relief valves to the tank: their flow holds them open, so that they close at P_crack - P_hyst.

A state S of each valve is 1 once it has opened and 0 once it has closed, behind a lag tau_relief of the poppet, and
P_crack - S P_hyst replaces P_crack in the flow of `relief_valve`: the further it opens, the lower the pressure that
keeps it open.

An effect of its own, because a valve without hysteresis needs no states.
"""

from collections.abc import Callable, Mapping
from math import inf

import numpy as np

from ...core.log import Log
from ._effect import Effect, EffectParameter, EffectState
from .relief_valve import POPPET, relief_flow

#: Pressure [Pa] beyond its limit at which the poppet moves at full rate, to keep the rate continuous.
P_LATCH = 1e4


def latch(P: float, S: float, P_crack: float, P_hyst: float, tau_relief: float) -> float:
    """dS/dt: towards 1 above P_crack - S P_hyst, towards 0 below, so that the valve snaps; zero without hysteresis."""
    above = P - (P_crack - S * P_hyst)
    opening = min(max(above, 0.0) / P_LATCH, 1.0)
    closing = min(max(-above, 0.0) / P_LATCH, 1.0)
    return ((1.0 - S) * opening - S * closing) / tau_relief if P_hyst > 0.0 else 0.0


def latch_1(P_1: float, S_1: float, P_crack: float, P_hyst: float, tau_relief: float) -> float:
    """The valve of chamber 1."""
    return latch(P_1, S_1, P_crack, P_hyst, tau_relief)


def latch_2(P_2: float, S_2: float, P_crack: float, P_hyst: float, tau_relief: float) -> float:
    """The valve of chamber 2."""
    return latch(P_2, S_2, P_crack, P_hyst, tau_relief)


def held_open(P: float, S: float, P_crack: float, P_open_range: float, K_relief: float, P_hyst: float) -> float:
    """Flow [m3/s] beyond that of a valve without hysteresis."""
    shut = relief_flow(P, P_crack, P_open_range, K_relief)
    return relief_flow(P, P_crack - S * P_hyst, P_open_range, K_relief) - shut if P_hyst > 0.0 else 0.0


def flow_1(
    Q_T1: float, P_1: float, S_1: float, P_crack: float, P_open_range: float, K_relief: float, P_hyst: float
) -> float:
    """Chamber 1 loses more while its valve is held open."""
    return Q_T1 - held_open(P_1, S_1, P_crack, P_open_range, K_relief, P_hyst)


def flow_2(
    Q_T2: float, P_2: float, S_2: float, P_crack: float, P_open_range: float, K_relief: float, P_hyst: float
) -> float:
    """Chamber 2 loses more while its valve is held open."""
    return Q_T2 - held_open(P_2, S_2, P_crack, P_open_range, K_relief, P_hyst)


def _held(channel: str) -> Callable[[Log, Mapping[str, float]], np.ndarray]:
    """(log, plant's parameters) -> (N,) whether the valve is open, from the logged pressure."""

    def along(log: Log, plant: Mapping[str, float]) -> np.ndarray:
        crack = plant.get("P_crack", inf)
        if channel not in log.channels or crack == inf:
            return np.zeros(len(log))
        opens, closes = log[channel] > crack, log[channel] < crack - plant.get("P_hyst", 0.0)
        # The state after each sample is that of the last sample that opened or closed the valve.
        last = np.maximum.accumulate(np.where(opens | closes, np.arange(len(log)), -1))
        return np.where(last >= 0, opens[np.maximum(last, 0)], False).astype(float)

    return along


effect = Effect(
    name="relief_hysteresis",
    place="flow",
    summary="relief valves to the tank close at a lower pressure than they open",
    fingerprint="after it has reached the cracking pressure, the pressure falls until the valve closes",
    changes={"Q_T1": flow_1, "Q_T2": flow_2},
    parameters=(
        EffectParameter("P_hyst", "Pa", "closing pressure below P_crack", 0.0, 10e5, 0.0),
        EffectParameter("tau_relief", "s", "lag of the poppet", POPPET, POPPET, 1e-4, 1.0, shape=True),
    ),
    states=(EffectState("S_1", "1", 0.5, along=_held("p1")), EffectState("S_2", "1", 0.5, along=_held("p2"))),
    adds={"S_1_dot": latch_1, "S_2_dot": latch_2},
    extends="relief_valve",
)
