"""Oil that warms up: viscous friction of shaft and rod falls with the running time, or with the dissipated heat.

B (1 - drop (1 - exp(-s))) with s = t / tau_w, or s = E / E_w where E_w is finite. The first is warming at a steady load
after a cold start. The second follows the load: E is the heat of the friction at shaft and rod, which warms the oil of
a closed circuit. In both, the viscosity falls in proportion to the rise of temperature, which is small. It cannot
rise: otherwise a motor that loses torque as it heats up would be named warming oil.
"""

from collections.abc import Mapping
from math import exp, inf

import numpy as np

from ...core.log import Log
from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number
from ._effect import Effect, EffectParameter, EffectState


def thinning(t_run: float, E_run: float, drop: float, tau_w: float, E_w: float) -> float:
    """Lost share of the viscous friction."""
    timed = E_w == inf
    return drop * (1.0 - exp(-((t_run if timed else E_run) / (tau_w if timed else E_w))))


def shaft(
    T_FM: float, omega: float, B_FM: float, t_run: float, E_run: float, drop: float, tau_w: float, E_w: float
) -> float:
    """Less viscous torque."""
    return T_FM - B_FM * omega * thinning(t_run, E_run, drop, tau_w, E_w)


def rod(F_FR: float, v: float, B_FR: float, t_run: float, E_run: float, drop: float, tau_w: float, E_w: float) -> float:
    """Less viscous force."""
    return F_FR - B_FR * v * thinning(t_run, E_run, drop, tau_w, E_w)


def clock(drop: float) -> float:
    """Rate of the running time; zero without the effect."""
    return 1.0 if drop != 0.0 else 0.0


def heating(T_FM: float, omega: float, F_FR: float, v: float, drop: float, E_w: float) -> float:
    """Power that friction dissipates [W], never negative; zero if only the time counts.

    The one contact of a servo stands for shaft and rod, and counts once.
    """
    rod_part = 0.0 if F_FR == T_FM and v == omega else F_FR * v
    return 0.0 if drop == 0.0 or E_w == inf else T_FM * omega + rod_part


def heat_of(log: Log, plant: Mapping[str, float]) -> np.ndarray:
    """Heat (N,) [J] of the nominal friction at the logged speed since the first sample; zero without a speed.

    The rod's speed is D omega / A, because the slope of a measured position is noise where the rod is slow.
    """
    if "speed" not in log.channels:
        return np.zeros(len(log))
    omega = np.abs(log["speed"])
    v = plant["D"] / plant["A"] * omega
    dry = plant.get("A_FM", 0.0) * omega + plant.get("A_FR", 0.0) * v
    power = dry + plant.get("B_FM", 0.0) * omega**2 + plant.get("B_FR", 0.0) * v**2
    return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * log.sample_time])


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A slow fall from the start of the log, with the time or with half of the heat of the log as its constant."""
    drop = effect_number(effect, context, "drop", 0.05)
    found = [CandidateEffect(effect, (drop, FreeNumber("tau_w", 10.0, 3.0, 0.5, 1e3)), ((0.05, 10.0),))]
    heat = 0.5 * float(heat_of(context.log, context.values)[-1])
    if heat > 0.0:
        constant = FreeNumber("E_w", heat, 0.3 * heat, 0.05 * heat, 100.0 * heat)
        found.append(CandidateEffect(effect, (drop, constant), ((0.05, heat),)))
    return found


effect = Effect(
    name="viscosity_warmup",
    place="torque",
    summary="viscous friction falls with running time, or with the heat that friction dissipates",
    fingerprint="torque and force errors ~ speed that grow slowly from the start of the log",
    changes={"T_FM": shaft, "F_FR": rod},
    parameters=(
        EffectParameter("drop", "1", "final lost share of viscous friction", 0.0, 0.3, 0.0, 0.95),
        EffectParameter("tau_w", "s", "time constant of the warming", 10.0, 10.0, 0.5, 1e5, shape=True),
        EffectParameter("E_w", "J", "heat constant; infinite: time counts", inf, inf, 1.0, shape=True),
    ),
    states=(
        EffectState("t_run", "s", 10.0, along=lambda log, plant: log.time - log.time[0]),
        EffectState("E_run", "J", 1e3, along=heat_of),
    ),
    adds={"t_run_dot": clock, "E_run_dot": heating},
    candidates=candidates,
    source="first-order warming, viscosity linear in temperature",
)
