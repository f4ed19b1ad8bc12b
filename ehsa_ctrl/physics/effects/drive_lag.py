"""A current loop of finite bandwidth: the current follows the command with a first-order lag."""

from math import inf

from ._effect import Effect, EffectParameter, EffectState


def current(current: float, asked_current: float, I_A: float, tau_I: float) -> float:
    """The lagging current plus the changes by other effects of the drive; the commanded current at tau_I = 0."""
    return I_A + (current - asked_current) if tau_I > 0.0 else current


def current_rate(asked_current: float, I_A: float, tau_I: float) -> float:
    """d I_A/dt = (I - I_A) / tau_I with the commanded current I."""
    return (asked_current - I_A) / max(tau_I, 1e-9) if tau_I > 0.0 else 0.0


effect = Effect(
    name="drive_lag",
    place="drive",
    summary="first-order lag of the motor current",
    fingerprint="torque error proportional to the rate of the current: after steps, not at steady current",
    changes={"current": current},
    parameters=(
        EffectParameter("tau_I", "s", "time constant", 0.0, 2e-3, 0.0, inf, detectable=1e-3, search=(0.0, 0.1)),
    ),
    states=(EffectState("I_A", "A", 1.0, starts_at="current"),),
    adds={"I_A_dot": current_rate},
    source="first-order current loop",
)
