"""A current loop of finite bandwidth: the current follows the command with a first-order lag."""

from math import inf

from ._effect import Effect, EffectParameter, EffectState


def current(current: float, asked_current: float, I_A: float, tau_I: float) -> float:
    """The lagging current, with what other effects of the drive add to it; the commanded one at tau_I = 0."""
    return I_A + (current - asked_current) if tau_I > 0.0 else current


def current_rate(asked_current: float, I_A: float, tau_I: float) -> float:
    """d I_A/dt = (I_asked - I_A) / tau_I."""
    return (asked_current - I_A) / max(tau_I, 1e-9) if tau_I > 0.0 else 0.0


effect = Effect(
    name="drive_lag",
    place="drive",
    summary="first-order lag of the motor current",
    fingerprint="torque error in proportion to the current's rate: after steps, not at steady current",
    changes={"current": current},
    parameters=(EffectParameter("tau_I", "s", "time constant", 0.0, 2e-3, 0.0, inf, felt=1e-3, search=(0.0, 0.1)),),
    states=(EffectState("I_A", "A", 1.0, starts_at="current"),),
    adds={"I_A_dot": current_rate},
    source="first-order current loop",
)
