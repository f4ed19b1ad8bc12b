"""A current loop of finite bandwidth: the current follows the command with a lag of first or second order.

tau_I I' + I = I_command, or b_I tau_I^2 I'' + tau_I I' + I = I_command, which has the natural frequency
1 / (tau_I sqrt(b_I)) and the damping 1 / (2 sqrt(b_I)): a loop whose controller or filter overshoots.
"""

from math import inf

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, from_neutral
from ._effect import Effect, EffectParameter, EffectState

#: Share of the second order in a diagnosis: damping 0.5, where its search starts, and 2.2 to 0.05 at the bounds. A
#: smaller share differs little from a lag of first order, and makes the equations stiff.
SECOND_ORDER = FreeNumber("b_I", 1.0, 0.1, 0.05, 100.0)


def current(current: float, asked_current: float, I_A: float, tau_I: float) -> float:
    """The lagging current plus the changes by other effects of the drive; the commanded current at tau_I = 0."""
    return I_A + (current - asked_current) if tau_I > 0.0 else current


def current_rate(asked_current: float, I_A: float, V_A: float, tau_I: float, b_I: float) -> float:
    """d I_A/dt with the commanded current I: (I - I_A) / tau_I, or V_A for a lag of second order."""
    return (V_A if b_I > 0.0 else (asked_current - I_A) / max(tau_I, 1e-9)) if tau_I > 0.0 else 0.0


def current_acceleration(asked_current: float, I_A: float, V_A: float, tau_I: float, b_I: float) -> float:
    """d V_A/dt of a lag of second order."""
    second = b_I * max(tau_I, 1e-9) * max(tau_I, 1e-9)
    return (asked_current - I_A - tau_I * V_A) / second if tau_I > 0.0 and b_I > 0.0 else 0.0


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """First order; and second."""
    return from_neutral(effect, context, SECOND_ORDER)


effect = Effect(
    name="drive_lag",
    place="drive",
    summary="lag of the motor current, of first or second order",
    fingerprint="torque error proportional to the rate of the current: after steps, not at steady current",
    changes={"current": current},
    parameters=(
        # A lag of 20 us changes the speed under a noise current by 0.08 % of its spread, and slows the run 24 times.
        EffectParameter(
            "tau_I", "s", "time constant", 0.0, 2e-3, 0.0, inf, detectable=1e-3, search=(0.0, 0.1), negligible=2e-5
        ),
        EffectParameter("b_I", "1", "second order: b_I tau_I^2 I'' + tau_I I' + I", 0.0, 0.0, 0.0),
    ),
    states=(EffectState("I_A", "A", 1.0, starts_at="current"), EffectState("V_A", "A/s", 1e3)),
    adds={"I_A_dot": current_rate, "V_A_dot": current_acceleration},
    candidates=candidates,
    source="lag of a current loop",
)
