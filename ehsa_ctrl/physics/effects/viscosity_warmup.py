"""Oil that warms up: viscous friction of shaft and rod falls with the running time.

B (1 - drop (1 - exp(-t / tau_w))): first-order warming after a cold start, small enough that the viscosity falls in
proportion to the rise of temperature.
"""

from math import exp

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, effect_number
from ._effect import Effect, EffectParameter, EffectState


def thinning(t_run: float, drop: float, tau_w: float) -> float:
    """Lost share of the viscous friction."""
    return drop * (1.0 - exp(-t_run / tau_w))


def shaft(T_FM: float, omega: float, B_FM: float, t_run: float, drop: float, tau_w: float) -> float:
    """Less viscous torque."""
    return T_FM - B_FM * omega * thinning(t_run, drop, tau_w)


def rod(F_FR: float, v: float, B_FR: float, t_run: float, drop: float, tau_w: float) -> float:
    """Less viscous force."""
    return F_FR - B_FR * v * thinning(t_run, drop, tau_w)


def clock(drop: float) -> float:
    """Rate of the running time; zero without the effect."""
    return 1.0 if drop != 0.0 else 0.0


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A slow fall from the start of the log."""
    warming = (effect_number(effect, context, "drop", 0.05), FreeNumber("tau_w", 10.0, 3.0, 0.5, 1e3))
    return [CandidateEffect(effect, warming, ((0.05, 10.0),))]


effect = Effect(
    name="viscosity_warmup",
    place="torque",
    summary="viscous friction falls with running time",
    fingerprint="torque and force errors ~ speed that grow slowly from the start of the log",
    changes={"T_FM": shaft, "F_FR": rod},
    parameters=(
        EffectParameter("drop", "1", "final lost share of viscous friction", 0.0, 0.3, -1.0, 0.95),
        EffectParameter("tau_w", "s", "time constant of the warming", 10.0, 10.0, 0.5, 1e5, shape=True),
    ),
    states=(EffectState("t_run", "s", 10.0, along=lambda log: log.time - log.time[0]),),
    adds={"t_run_dot": clock},
    candidates=candidates,
    source="first-order warming, viscosity linear in temperature",
)
