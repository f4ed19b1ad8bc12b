"""The laws of the effects, one function each, compiled into the kernel."""

from __future__ import annotations

from math import atan, cos, exp, pi, sinh, sqrt, tanh

from numba import njit
from rig import P_ATM


@njit(cache=True, error_model="numpy")
def saturated(current, k, law):
    """Torque-producing current; all laws fall as 1 - (k I)^2 at first."""
    u = k * current
    if abs(u) < 1e-9:
        return current
    if law == 0.0:
        return current / (1.0 + u * u)
    if law == 1.0:
        return current * tanh(sqrt(3.0) * u) / (sqrt(3.0) * u)
    return current * atan(sqrt(3.0) * u) / (sqrt(3.0) * u)


@njit(cache=True, error_model="numpy")
def orifice(dP, K_t, law):
    """Flow through a wear gap whose loss grows with the square of the flow."""
    if law == 0.0:
        return K_t * dP / sqrt(sqrt(dP * dP + 4e6))
    # a Q^2 + b Q = |dP|: laminar below some hundredths of a bar, turbulent above.
    b = 40.0 / K_t
    flow = K_t * K_t * 0.5 * (sqrt(b * b + 4.0 * abs(dP) / (K_t * K_t)) - b)
    return flow if dP > 0.0 else -flow


@njit(cache=True, error_model="numpy")
def stiffness(P, beta, air, law):
    """Bulk modulus of oil with free air, from the compliances of both; air is its share at 1 atm."""
    absolute = max(P + P_ATM, 2e3)
    n = 1.0 if law == 0.0 else 1.4
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
    """Force of an end stop [N]: 2e7 N/m, or a contact that stiffens with depth."""
    if depth <= 0.0:
        return 0.0
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
