"""Cogging: a torque that is periodic in the shaft angle.

T_M + T_c (sin(n_c theta + phi_c) + a_c2 sin(n_c2 theta + phi_c2)); theta is the shaft angle since the start. The second
wave is a harmonic of the first, or of another origin: poles and slots, teeth of the pump.
"""

from math import inf, sin

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber
from ._effect import Effect, EffectParameter, EffectState, MeasuredReplay
from ._shaft_angle import ANGLE, angle_of, ripple_current, strongest_orders, two_waves, with_angle


def torque(
    T_M: float, theta: float, T_c: float, n_c: float, phi_c: float, a_c2: float, n_c2: float, phi_c2: float
) -> float:
    """T_M + T_c (sin(n_c theta + phi_c) + a_c2 sin(n_c2 theta + phi_c2))."""
    return T_M + T_c * (sin(n_c * theta + phi_c) + a_c2 * sin(n_c2 * theta + phi_c2))


def angle_rate(omega: float, T_c: float) -> float:
    """d theta/dt = omega, or zero without a ripple."""
    return omega if T_c != 0.0 else 0.0


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """One start for each of the strongest orders in the torque balance: no gradient leads to the order of a ripple.

    With a second wave too if its order stands out in the balance.
    """
    orders = strongest_orders(context.values, context.log) if "speed" in context.log.channels else []
    if not orders:
        return []
    free = (
        FreeNumber("T_c", 0.0, 0.03, 0.0, inf),
        # Fixed by the start: each has its own order.
        FreeNumber("n_c", orders[0][0], 1e-6, 1.0, 200.0, fixed=True),
        FreeNumber("phi_c", 0.0, 0.3, -7.0, 7.0),
    )
    found = [CandidateEffect(effect, free, tuple((amplitude, order, phase) for order, amplitude, phase in orders))]
    waves = two_waves(context.values, context.log)
    if waves:
        (n, size, phase), (n_2, size_2, phase_2) = waves
        second = (
            FreeNumber("a_c2", 0.0, 0.1, 0.0, 10.0),
            FreeNumber("n_c2", n_2, 1e-6, 1.0, 200.0, fixed=True),
            FreeNumber("phi_c2", 0.0, 0.3, -7.0, 7.0),
        )
        found.append(CandidateEffect(effect, (*free, *second), ((size, n, phase, size_2 / size, n_2, phase_2),)))
    return found


effect = Effect(
    name="torque_ripple",
    place="torque",
    summary="cogging torque, periodic in the shaft angle",
    fingerprint="torque error periodic in the shaft angle, visible at low speed",
    changes={"T_M": torque},
    parameters=(
        EffectParameter("T_c", "N m", "amplitude", 0.0, 0.05, 0.0),
        EffectParameter("n_c", "1", "periods per turn", 36.0, 36.0, 1.0, 200.0, shape=True),
        EffectParameter("phi_c", "rad", "phase at the start", 0.0, 0.0, -7.0, 7.0, shape=True),
        EffectParameter("a_c2", "1", "amplitude of a second wave, in T_c", 0.0, 0.0, 0.0, 10.0, shape=True),
        EffectParameter("n_c2", "1", "its periods per turn", 72.0, 72.0, 1.0, 200.0, shape=True),
        EffectParameter("phi_c2", "rad", "its phase at the start", 0.0, 0.0, -7.0, 7.0, shape=True),
    ),
    states=(EffectState("theta", "rad", 1.0, along=lambda log, plant: angle_of(log)),),
    adds={"theta_dot": angle_rate},
    candidates=candidates,
    # A small error of the simulated speed soon makes the angle wrong by whole turns; the ripple would act as noise.
    replay=MeasuredReplay(ANGLE, with_angle, ripple_current, ("K_T", "T_c", "n_c", "phi_c", "a_c2", "n_c2", "phi_c2")),
    caveat="in these runs the torque ripple follows the measured shaft angle; in a free run of the improved plant the "
    "angle drifts, so that the ripple has the right amplitude but not the right phase",
    source="textbook form",
)
