"""LuGre: friction as the deflection z of bristles, with presliding and friction lag.

The law is not set-valued: a contact at rest yields elastically by effort / sigma_0. With a constant sigma_1 it is not
passive for all parameters: the bristle damping can feed energy back when g(v) falls steeply.

Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A new model for control of systems with
friction", IEEE Trans. Automatic Control 40(3), 1995. The Stribeck curve g is that of (8), so that both laws agree at
constant speed.
"""

from math import exp

from ._law import FrictionLaw


def state_rate(speed: float, z: float, A: float, C: float, tau: float, sigma_0: float) -> float:
    """dz/dt = v - sigma_0 |v| z / g(v), g(v) = A + C exp(-|v|/tau)."""
    return speed - sigma_0 * abs(speed) * z / (A + C * exp(-abs(speed) / tau))


def effort(speed: float, z: float, z_dot: float, B: float, sigma_0: float, sigma_1: float) -> float:
    """F = sigma_0 z + sigma_1 dz/dt + B v."""
    return sigma_0 * z + sigma_1 * z_dot + B * speed


law = FrictionLaw(
    "lugre",
    "bristle deflection: presliding and friction lag",
    effort,
    sticks=False,
    state_rate=state_rate,
    passive=False,
)
