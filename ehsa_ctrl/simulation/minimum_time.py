"""Minimum time of a rod motion: a lower bound to compare settling times with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.errors import InputError
from ..physics import load
from ..plant.plant import Plant
from ..plant.system import Contact

#: Number of segments of the path. Engineering judgement.
PARTS = 200


def shortest_time(
    plant: Plant,
    distance: float,
    current_limit: float,
    *,
    start: float = 0.0,
    band: float = 0.0,
    speed_limit: float | None = None,
) -> float:
    """Lower bound [s] of the time from rest at `start` until the rod stays within `band` of `start + distance`.

    The motion is the time-optimal one of a single inertia (e.g. J. E. Bobrow, S. Dubowsky, J. S. Gibson, "Time-optimal
    control of robotic manipulators along specified paths", Int. J. Robotics Research 4(3), 1985): full current up to
    the speed limit of the pump, then full braking, to rest at the far edge of the band.

    The model: incompressible oil, so that shaft and rod move together (omega D = A v); the plant's friction at both
    contacts; its load without an external force; no leakage, no delay, no rise time of the current. These omissions
    make it faster than the plant, so that the result is a bound; compressed oil can push the rod ahead of the pump only
    for the few milliseconds of its relaxation.

    Parameters
    ----------
    distance: of either sign [m].
    current_limit: A.
    start: position at the start [m].
    band: half width of the band around the target [m].
    speed_limit: of the shaft [rad/s]; by default the lower one of the plant's limits of pump and motor.

    Returns
    -------
    Seconds; inf if the current can't move the rod there or can't stop it there.

    Raises
    ------
    InputError: a distance of zero, a current limit that is not positive, a band as long as the distance.
    """
    if not (np.isfinite(distance) and distance != 0.0 and 0.0 < current_limit < np.inf):
        raise InputError(
            f"shortest time over {distance:g} m with {current_limit:g} A: expected a distance other than zero and a "
            "current limit greater than zero"
        )
    if not 0.0 <= band < abs(distance):
        raise InputError(f"band = {band:g} m: expected at least 0 m and less than the distance {abs(distance):g} m")
    limits = [plant.limits[name].value for name in ("pump_speed", "motor_speed") if name in plant.limits]
    fastest = speed_limit if speed_limit is not None else min(limits, default=np.inf)
    way = 1.0 if distance > 0 else -1.0
    rate = _acceleration(plant, way)
    # The integrated variable is omega^2 / 2 over the shaft angle: its slope is the acceleration, smooth even at rest.
    places = start + way * np.linspace(0.0, abs(distance) + band, PARTS + 1)
    step = (abs(distance) + band) / PARTS * plant["A"] / plant["D"]
    ceiling = 0.5 * fastest**2
    speeding = _integrate(lambda x, omega: rate(x, omega, current_limit), places, step, ceiling)
    braking = _integrate(lambda x, omega: -rate(x, omega, -current_limit), places[::-1], step, ceiling)[::-1]
    speed = np.sqrt(2.0 * np.minimum(speeding, braking))
    mean = 0.5 * (speed[1:] + speed[:-1])
    there = way * (places - start)
    needed = int(np.searchsorted(there, abs(distance) - band)) - 1 if band > 0.0 else PARTS
    if np.any(mean[: needed + 1] <= 0.0):
        return float("inf")
    times = np.concatenate([[0.0], np.cumsum(step / mean[: needed + 1])])
    return float(np.interp(abs(distance) - band, there[: times.size], times))


def _integrate(slope: Callable[[float, float], float], places: np.ndarray, step: float, ceiling: float) -> np.ndarray:
    """omega^2 / 2 at each position, from rest at the first one, by Heun's method; limited to `ceiling`."""
    energy = np.zeros(places.size)
    for k in range(places.size - 1):
        first = slope(places[k], (2.0 * energy[k]) ** 0.5)
        guess = min(max(energy[k] + step * first, 0.0), ceiling)
        second = slope(places[k + 1], (2.0 * guess) ** 0.5)
        energy[k + 1] = min(max(energy[k] + 0.5 * step * (first + second), 0.0), ceiling)
        if energy[k + 1] == 0.0:
            break
    return energy


def _acceleration(plant: Plant, way: float) -> Callable[[float, float, float], float]:
    """Function (rod position, shaft speed, current) -> shaft acceleration [rad/s2]; positive along `way`."""
    travel = plant["D"] / plant["A"]
    inertia = plant["J_M"] + (plant["M"] + plant["m_L"]) * travel**2
    shaft, rod = (_friction(plant, contact) for contact in plant.structure.system.contacts)
    K_T = plant["K_T"]
    spring = {name: plant[name] for name in ("K_S", "F_pre", "k_3", "F_0")}

    def rate(x: float, omega: float, current: float) -> float:
        resists = way * load.force(load.deflection(x, plant["x_C"], plant["x_R"]), **spring, F_D=0.0)
        return (K_T * current - shaft(omega) - travel * (resists + rod(travel * omega))) / inertia

    return rate


def _friction(plant: Plant, contact: Contact) -> Callable[[float], float]:
    """Function speed >= 0 -> friction of a contact, with an inner state at its value for constant speed."""
    law = plant.structure.law(contact)
    symbols = {symbol: plant[contact.symbol(symbol)] for symbol in law.symbols if symbol != law.band}
    if law.state_rate is None:
        wanted = law.effort.__code__.co_varnames[: law.effort.__code__.co_argcount]
        if "direction" in wanted:
            return lambda speed: law.effort(direction=1.0, speed=speed, **symbols)
        return lambda speed: law.effort(speed=speed, **symbols)
    outer = law.effort.__code__.co_varnames[: law.effort.__code__.co_argcount]

    def effort(speed: float) -> float:
        z = law.steady_state(max(speed, 1e-9), symbols)
        return law.effort(speed=speed, z=z, z_dot=0.0, **{k: v for k, v in symbols.items() if k in outer})

    return effort
