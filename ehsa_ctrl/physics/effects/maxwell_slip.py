"""Maxwell slip: dry friction of the rod as three sliders in parallel, each behind a spring, and a small rigid one.

The weakest slider slips first, so that the force over the position remembers several reversals. The springs are alike,
1 / (3 s) each for a compliance s of the rod; the sliders hold 1/6, 2/6 and 3/6 of A_FR + C_FR. A slider with the
deflection z and the limit z_m is a spring without loss up to 97 % of z_m; then it begins to slip, dz/dt = r v with r
falling from 1 to 0 at z_m. The share 1 - r that slips feels the Stribeck curve. So the force takes up at least the work
that it gives back, and at constant speed all sliders together are (8). The rigid slider keeps sticking exact.

Source of the model: D. D. Rizos, S. D. Fassois, "Friction identification based upon the LuGre and Maxwell slip models",
IEEE Trans. Control Systems Technology 17(1), 2009; the gradual slip is derived here.
"""

from math import exp

from ._candidate import DiagnosisContext, FreeNumber, effect_number
from ._effect import Effect, EffectParameter, EffectState

#: Share of the limit over which a slider begins to slip: a kink would cost the integrator many steps.
BAND = 0.03
#: Share of the dry friction that the rigid slider holds.
RIGID = 0.02
#: Compliance [m/N] of a rod that sticks. Engineering judgement: a log can't distinguish stiffer springs or bristles,
#: 1e9 N/m, from exact sticking.
NEGLIGIBLE_COMPLIANCE = 1e-9


def sticking(v: float, z: float, limit: float) -> float:
    """Share r of the motion that the spring follows: 1 inside and on the way back, 0 at the limit."""
    ahead = z if v > 0.0 else -z
    return min(max((1.0 - ahead / limit) / BAND, 0.0), 1.0)


def limit(share: float, A_FR: float, C_FR: float, s_slip: float) -> float:
    """Largest deflection [m] of a slider that holds this share of breakaway friction."""
    return 3.0 * s_slip * share * (A_FR + C_FR)


def rate_1(v: float, z_S1: float, A_FR: float, C_FR: float, s_slip: float) -> float:
    """dz/dt of the weakest slider [m/s]; zero without the effect."""
    return v * sticking(v, z_S1, limit(1.0 / 6.0, A_FR, C_FR, s_slip)) if s_slip > 0.0 else 0.0


def rate_2(v: float, z_S2: float, A_FR: float, C_FR: float, s_slip: float) -> float:
    """The second slider."""
    return v * sticking(v, z_S2, limit(2.0 / 6.0, A_FR, C_FR, s_slip)) if s_slip > 0.0 else 0.0


def rate_3(v: float, z_S3: float, A_FR: float, C_FR: float, s_slip: float) -> float:
    """The strongest slider."""
    return v * sticking(v, z_S3, limit(3.0 / 6.0, A_FR, C_FR, s_slip)) if s_slip > 0.0 else 0.0


def spring(v: float, z: float, share: float, A_FR: float, C_FR: float, tau_FR: float, s_slip: float) -> float:
    """Force of a slider [N]: its spring's, reduced along the Stribeck curve by the share that slips."""
    slipping = 1.0 - sticking(v, z, limit(share, A_FR, C_FR, s_slip))
    fall = C_FR / (A_FR + C_FR) * (1.0 - exp(-abs(v) / tau_FR))
    return z / (3.0 * s_slip) * (1.0 - fall * slipping)


def friction(F_FR: float, d_R: float, v: float, A_FR: float, C_FR: float, tau_FR: float, s_slip: float) -> float:
    """F_FR with the rigid slider's share of its dry part, which it keeps where another effect has less friction."""
    level = A_FR + C_FR * exp(-d_R * v / tau_FR)
    elastic = min((1.0 - RIGID) * level, max(d_R * F_FR - RIGID * level, 0.0))
    return F_FR - d_R * elastic if s_slip > 0.0 else F_FR


def net_force(
    F_net: float, v: float, z_S1: float, z_S2: float, z_S3: float,
    A_FR: float, C_FR: float, tau_FR: float, s_slip: float,
) -> float:  # fmt: skip
    """The springs push on the rod, at rest too."""
    weak = spring(v, z_S1, 1.0 / 6.0, A_FR, C_FR, tau_FR, s_slip)
    middle = spring(v, z_S2, 2.0 / 6.0, A_FR, C_FR, tau_FR, s_slip)
    strong = spring(v, z_S3, 3.0 / 6.0, A_FR, C_FR, tau_FR, s_slip)
    return F_net - (1.0 - RIGID) * (weak + middle + strong) if s_slip > 0.0 else F_net


effect = Effect(
    name="maxwell_slip",
    place="force",
    summary="elastic sliders of the rod's friction, which slip one after the other (Maxwell slip)",
    fingerprint="hysteresis of force over position at reversals, with a memory of several reversals",
    changes={"F_FR": friction, "F_net": net_force},
    parameters=(
        EffectParameter(
            "s_slip", "m/N", "compliance of the rod at rest", 0.0, 5e-8, 0.0, 1e-5, negligible=NEGLIGIBLE_COMPLIANCE
        ),
    ),
    states=tuple(EffectState(f"z_S{k}", "m", 1e-5) for k in (1, 2, 3)),
    adds={"z_S1_dot": rate_1, "z_S2_dot": rate_2, "z_S3_dot": rate_3},
    extends="presliding",
)


def sliders(context: DiagnosisContext) -> FreeNumber | None:
    """The compliance as a free number of an effect that has this form too; None where no simulation depends on it."""
    return effect_number(effect, context, "s_slip", effect.parameters[0].scale) if context.simulated("s_slip") else None
