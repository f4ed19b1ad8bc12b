"""The laws of the effects, one function each, compiled into the kernel."""

from __future__ import annotations

from math import atan, cos, exp, pi, sinh, sqrt, tanh

from numba import njit
from rig import P_ATM


@njit(cache=True, error_model="numpy")
def saturated(current, k, law):
    """Torque-producing current; all laws but the last fall as 1 - (k I)^2 at first.

    Law 3 is a hard knee: straight up to 0.5 / k, from there on with 40 % of the slope.
    """
    u = k * current
    if abs(u) < 1e-9:
        return current
    if law == 0.0:
        return current / (1.0 + u * u)
    if law == 1.0:
        return current * tanh(sqrt(3.0) * u) / (sqrt(3.0) * u)
    if law == 3.0:
        return current - 0.6 * beyond(current, 0.5 / k)
    return current * atan(sqrt(3.0) * u) / (sqrt(3.0) * u)


@njit(cache=True, error_model="numpy")
def orifice(dP, K_t, law):
    """Flow through a wear gap whose loss grows with the square of the flow."""
    if law == 0.0:
        return K_t * dP / sqrt(sqrt(dP * dP + 4e6))
    if law == 2.0:
        # A gap between laminar and turbulent: power 0.7, equal to the root at 10 bar.
        return K_t * 1e3 * (1.0 if dP > 0.0 else -1.0) * (abs(dP) / 1e6) ** 0.7
    # a Q^2 + b Q = |dP|: laminar below some hundredths of a bar, turbulent above.
    b = 40.0 / K_t
    flow = K_t * K_t * 0.5 * (sqrt(b * b + 4.0 * abs(dP) / (K_t * K_t)) - b)
    return flow if dP > 0.0 else -flow


@njit(cache=True, error_model="numpy")
def stiffness(P, beta, air, law):
    """Bulk modulus of oil with free air, from the compliances of both; air is its share at 1 atm."""
    absolute = max(P + P_ATM, 2e3)
    n = 1.0 if law in (0.0, 3.0) else 1.4
    gas = air / (1.0 - air) * (P_ATM / absolute) ** (1.0 / n)
    if law == 2.0:
        gas *= max(1.0 - absolute / 3e7, 0.05)
    return (1.0 + gas) / (1.0 / beta + gas / (n * absolute))


@njit(cache=True, error_model="numpy")
def bump(x, place, width, law):
    u = abs(x - place) / width
    if law == 0.0:
        return 0.5 * (1.0 + cos(pi * u)) if u < 1.0 else 0.0
    if law == 1.0:
        return max(1.0 - u, 0.0)
    if law == 3.0:
        # A bore with waves along the stroke.
        return 0.5 * (1.0 + cos(pi * u))
    return 1.0 / (1.0 + 4.0 * u * u)


@njit(cache=True, error_model="numpy")
def spring(x, K_S, k_3, law):
    if k_3 == 0.0:
        return K_S * x
    if law == 0.0 or K_S <= 0.0:
        return K_S * x + k_3 * x**3
    # sinh with the same slope and the same cubic term
    a = sqrt(6.0 * abs(k_3) / K_S)
    return K_S * sinh(a * x) / a


@njit(cache=True, error_model="numpy")
def contact(depth, speed, law):
    """Force of an end stop [N]: 2e7 N/m, a contact that stiffens with depth, or an oil cushion that only brakes."""
    if depth <= 0.0:
        return 0.0
    if law == 2.0:
        return 2e7 * depth * max(speed, 0.0) + 1e5 * depth
    stiff = 2e7 * depth if law == 0.0 else 1.5e9 * depth * sqrt(depth)
    return max(stiff * (1.0 + 1.5 * speed), 0.0)


@njit(cache=True, error_model="numpy")
def beyond(u, half):
    """The part of u outside a dead zone of +-half."""
    if u > half:
        return u - half
    if u < -half:
        return u + half
    return 0.0


@njit(cache=True, error_model="numpy")
def turbulent(flow, exponent):
    """Pressure loss over R_turb; 1.75 is Blasius' law, with its coefficient chosen equal to the square at 1e-4 m3/s."""
    if exponent == 2.0:
        return flow * abs(flow)
    return 1e-8 * (1.0 if flow > 0.0 else -1.0) * (abs(flow) / 1e-4) ** exponent


@njit(cache=True, error_model="numpy")
def free_air(P, air):
    """Share of free air (at 1 atm) in equilibrium: Henry's law, all of it dissolved from 60 bar on, but for 5 %."""
    return air * max(1.0 - max(P, 0.0) / 60e5, 0.05)


@njit(cache=True, error_model="numpy")
def maxwell_slip(force, pull, level):
    """Move three elastic sliders in parallel: `pull` is the force of the rigid motion, `level` that of all sliding.

    force: (3,) [N] of each, changed in place. Stiffness is shared alike; the weakest slides first.
    """
    for i in range(3):
        limit = level * (i + 1.0) / 6.0
        force[i] = min(max(force[i] + pull / 3.0, -limit), limit)


@njit(cache=True, error_model="numpy")
def stribeck(u, C, tau):
    return C * exp(-abs(u) / tau) if C != 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def slide(v, force, mass, B, up, down, C, tau, step):
    """Speed after one step of a body with set-valued dry friction.

    `up` and `down` are the Coulomb levels of either direction, C and tau the Stribeck part, B the viscous slope, which
    is taken at the middle of the step. A body that comes to rest inside the step either stays or spends the rest of
    the step sliding the other way.
    """
    if v == 0.0:
        if force > up + C:
            sign = 1.0
        elif force < -(down + C):
            sign = -1.0
        else:
            return 0.0
    else:
        sign = 1.0 if v > 0.0 else -1.0
    level = up if sign > 0.0 else down
    inertia, drag = mass / step, 0.5 * B
    new = ((inertia - drag) * v + force - sign * (level + stribeck(v, C, tau))) / (inertia + drag)
    if new * sign > 0.0:
        middle = 0.5 * (v + new)
        new = ((inertia - drag) * v + force - sign * (level + stribeck(middle, C, tau))) / (inertia + drag)
        if new * sign > 0.0:
            return new
    if v == 0.0:
        return 0.0
    rest = step * (1.0 - v / (v - new))
    if force > up + C:
        return (force - up - C) * rest / mass
    if force < -(down + C):
        return (force + down + C) * rest / mass
    return 0.0
