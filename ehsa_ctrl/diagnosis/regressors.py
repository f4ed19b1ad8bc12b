"""Regressors of an unknown input: candidate functions of the variables on which it may depend.

A function of a variable is piecewise linear, as a sum of hat functions between quantiles. For the drive there are the
errors that a delay, a lag, a rate limit or a dead band makes. The numbers of hat functions and the grids of delays and
limits are engineering judgement: fine enough for a curve, coarse enough for a fit to some thousand samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..identification.logged_inputs import lag_current
from ..plant.arrays import array_evaluator, needs
from ..plant.plant import Plant
from ..plant.system import Contact
from .unknown_inputs import BalanceSignals, fill_nan


@dataclass(frozen=True)
class Regressors:
    """Regressors that describe one kind of dependence on a variable.

    family: kind of function. against, unit: the variable, in words. variable: (N - 1,). columns: (N - 1, k). fixed: the
    column has no free factor. number: the nonlinear parameter of a drive error, or the order of a ripple. sign: (N -
    1,) sign of the motion, if the columns change sign with it; their mean over the variable would be zero without it.
    """

    family: str
    against: str
    unit: str
    variable: np.ndarray
    columns: np.ndarray
    fixed: bool = False
    number: float = float("nan")
    sign: np.ndarray | None = None


def hats(z: np.ndarray, count: int) -> np.ndarray:
    """(N, k) hat functions (linear B-splines) with knots at quantiles of z; they add up to one."""
    knots = np.unique(np.quantile(z, np.linspace(0.005, 0.995, count)))
    if knots.size < 2:
        return np.ones((z.size, 1))
    return np.column_stack([np.interp(z, knots, row) for row in np.eye(knots.size)])


def odd_hats(z: np.ndarray, sign: np.ndarray, count: int) -> np.ndarray:
    """(N, k) hat functions of |z| times a sign, for a dependence that reverses with the motion."""
    return np.asarray(sign[:, None] * hats(np.abs(z), count))


def two_sided_hats(z: np.ndarray, sign: np.ndarray, count: int) -> np.ndarray:
    """(N, k) separate hat functions for each sign of the motion, with a jump between. sign: -1 to 1."""
    shares = np.clip(0.5 * (1.0 - sign), 0.0, 1.0), np.clip(0.5 * (1.0 + sign), 0.0, 1.0)
    parts = [share[:, None] * hats(np.where(share > 0.5, z, 0.0), count) for share in shares]
    return np.column_stack([part[:, np.any(part != 0.0, axis=0)] for part in parts])


def balance_contact(plant: Plant, balance: str) -> Contact:
    """The contact whose friction is a term of a balance."""
    system = plant.structure.system
    names = {name for one in system.balances if balance in one.unknown_inputs for name in one.contacts}
    return next(contact for contact in system.all_contacts if contact.name in names)


def contact_efforts(plant: Plant, s: BalanceSignals, contact: Contact) -> dict[str, np.ndarray]:
    """Effort on a contact -> (N,) along a log, by the plant's equations; absent where it needs a signal that is."""
    equations = plant.structure.equations
    known = {**plant.values, **s.values}
    shown = [name for name in contact.efforts if needs(equations, name) <= known.keys()]
    size = s["time"].size
    return {name: values * np.ones(size) for name, values in array_evaluator(equations, shown)(known).items()}


def _sure_sign(s: BalanceSignals, contact: Contact) -> np.ndarray:
    """(N - 1,) sign of the motion where a contact slides with certainty, interpolated between."""
    return fill_nan(np.where(s.slides[contact.name], s[contact.direction], np.nan))[:-1]


def shows_pressures(plant: Plant, s: BalanceSignals) -> bool:
    """Whether a system with two chambers has both pressures among the signals."""
    return bool(plant.structure.system.pressures) and all(name in s for name in plant.structure.system.pressures)


def pressure_difference(plant: Plant, s: BalanceSignals) -> np.ndarray:
    """(N - 1,) difference of the chambers' pressures [Pa]."""
    first, second = plant.structure.system.pressures
    return np.asarray((s[first] - s[second])[:-1])


def shaft_angle(plant: Plant, s: BalanceSignals) -> np.ndarray:
    """(N - 1,) integral of the shaft's speed [rad]."""
    omega = s[balance_contact(plant, "torque").velocity]
    return np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * s.sample_time])[:-1]


def delay_current(current: np.ndarray, samples: float) -> np.ndarray:
    """(N,) mean over each sample of a held current (N,) delayed by `samples`, which may be fractional."""
    whole = int(samples)
    part = samples - whole
    before = np.concatenate([np.full(whole + 1, current[0]), current])
    return (1.0 - part) * before[1 : current.size + 1] + part * before[: current.size]


def limit_rate(current: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(N, k) mean over each sample of a current (N,) that changes by at most `steps` (k,) per sample."""
    out, now = np.empty((current.size, steps.size)), np.full(steps.size, current[0])
    for k, value in enumerate(current.tolist()):
        way = value - now
        moved = np.minimum(np.maximum(way, -steps), steps)
        # It ramps to the value and holds it for the remainder of the sample.
        out[k] = now + moved * (1.0 - 0.5 * np.minimum(np.abs(way) / steps, 1.0))
        now = now + moved
    return out


@dataclass(frozen=True)
class TorqueDrive:
    """What drives a shaft along a log: held (N - 1,), torque per unit of it, its name and unit."""

    held: np.ndarray
    gain: float
    words: str
    unit: str


def torque_drive(plant: Plant, s: BalanceSignals) -> TorqueDrive:
    """The current, where an unknown torque acts as a current; otherwise the torque of the motor."""
    system = plant.structure.system
    entry = system.entries.get("torque")
    if entry is None or entry.target == system.inputs[0]:
        gain = plant[entry.capacity[0]] if entry is not None and entry.capacity else 1.0
        return TorqueDrive(s[system.inputs[0]][:-1], gain, "the current", "A")
    (term,) = next(balance.terms for balance in system.balances if "torque" in balance.unknown_inputs)
    torque = array_evaluator(plant.structure.equations, [term])({**plant.values, **s.values})[term]
    return TorqueDrive(np.asarray(torque)[:-1], 1.0, "the motor's torque", "N m")


#: Families of torque errors that are attributed to the drive: independent of the motion, or an error of the current.
DRIVE_FAMILIES = ("constant", "time", "delay", "lag", "rate limit", "dead band", "current")
#: Static functions of the current, which a wrong torque constant or friction can produce too.
MEMORYLESS = ("dead band", "current")
#: Families with a nonlinear parameter.
NONLINEAR = ("delay", "lag", "rate limit", "dead band")


def torque_regressors(plant: Plant, s: BalanceSignals, orders: tuple[float, ...]) -> list[Regressors]:
    """Regressors of an unknown torque. orders: periods of a ripple per turn of the shaft."""
    drive, dt, shaft = torque_drive(plant, s), s.sample_time, balance_contact(plant, "torque")
    held, current, unit = drive.held, drive.words, drive.unit
    omega, rate, time = (s[n][:-1] for n in (shaft.velocity, f"{shaft.velocity}_rate", "time"))
    sign, push, size = _sure_sign(s, shaft), np.sign(held), np.abs(held)
    speed, against = "the shaft's speed", "time, against the motion"
    found = [
        Regressors("constant", "time", "s", time, np.ones((held.size, 1))),
        Regressors("time", "time", "s", time, hats(time, 14)),
        Regressors("sign", f"the sign of {speed}", "", sign, sign[:, None]),
        Regressors("speed", speed, "rad/s", omega, odd_hats(omega, sign, 7)),
        Regressors("linear", speed, "rad/s", omega, omega[:, None]),
        Regressors("rate", "the shaft's acceleration", "rad/s2", rate, rate[:, None]),
        Regressors("gain", current, unit, held, held[:, None]),
        Regressors("saturation", current, unit, held, np.column_stack([held, held * size, held**3])),
        Regressors("signed time", against, "s", time, sign[:, None] * hats(time, 8), sign=sign),
        Regressors("gain in time", "time, with the current", "s", time, held[:, None] * hats(time, 8), sign=push),
        Regressors(
            "brake",
            f"the size of {current}, against the motion",
            unit,
            size,
            odd_hats(held, sign, 10),
            sign=sign,
        ),
        Regressors("current", current, unit, held, hats(held, 80)),
    ]
    if shows_pressures(plant, s):
        dP, drop = pressure_difference(plant, s), "the pressure difference"
        loss = (sign * np.abs(dP))[:, None]
        found += [
            Regressors("linear", drop, "Pa", dP, dP[:, None]),
            Regressors("pressure", drop, "Pa", dP, odd_hats(dP, np.sign(dP), 7)),
            Regressors("loss", f"{drop}, against the motion", "Pa", np.abs(dP), loss, sign=sign),
        ]
    found += [_ripple(shaft_angle(plant, s), order) for order in orders]
    times = dt * np.array([0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 15])
    top = float(np.max(size)) if np.any(held) else 1.0
    for family, numbers in {
        "delay": times,
        "lag": times,
        "rate limit": top / dt * np.array([0.005, 0.01, 0.02, 0.03, 0.045, 0.07, 0.1, 0.15, 0.3]),
        "dead band": top * np.array([0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2]),
    }.items():
        found += drive_regressors(plant, s, family, numbers)
    return found


def drive_regressors(plant: Plant, s: BalanceSignals, family: str, numbers: np.ndarray) -> list[Regressors]:
    """Torque errors of a drive with a delay [s], a lag [s], a rate limit [A/s] or a dead band [A], one per number."""
    drive, dt = torque_drive(plant, s), s.sample_time
    held = drive.held
    if family == "rate limit":
        given = list(limit_rate(held, numbers * dt).T)
    else:
        of: dict[str, Callable[[float], np.ndarray]] = {
            "delay": lambda number: delay_current(held, number / dt),
            "lag": lambda number: lag_current(held, number / dt),
            "dead band": lambda number: np.asarray(held - np.clip(held, -number, number)),
        }
        given = [of[family](float(number)) for number in numbers]
    words = f"changes of {drive.words}" if family != "dead band" else drive.words
    return [
        Regressors(family, words, drive.unit, held, (drive.gain * (other - held))[:, None], True, float(number))
        for other, number in zip(given, numbers, strict=True)
    ]


def force_regressors(plant: Plant, s: BalanceSignals) -> list[Regressors]:
    """Regressors of an unknown force."""
    rod = balance_contact(plant, "force")
    x, v, time, rate = (s[n][:-1] for n in (rod.position, rod.velocity, "time", f"{rod.velocity}_rate"))
    sign = _sure_sign(s, rod)
    place, speed, against = "the rod's position", "the rod's speed", "against the motion"
    found = [
        Regressors("constant", "time", "s", time, np.ones((x.size, 1))),
        Regressors("sign", f"the sign of {speed}", "", sign, sign[:, None]),
        Regressors("sides", f"the sign of {speed}, asymmetric", "", sign, two_sided_hats(np.zeros_like(sign), sign, 2)),
        Regressors("speed", speed, "m/s", v, two_sided_hats(v, sign, 6)),
        Regressors("linear", speed, "m/s", v, v[:, None]),
        Regressors("rate", "the rod's acceleration", "m/s2", rate, rate[:, None]),
        Regressors("position", place, "m", x, hats(x, 12)),
        Regressors("linear", place, "m", x, x[:, None]),
        Regressors("signed position", f"{place}, {against}", "m", x, sign[:, None] * hats(x, 20), sign=sign),
        Regressors("time", "time", "s", time, hats(time, 20)),
        Regressors("signed time", f"time, {against}", "s", time, sign[:, None] * hats(time, 14), sign=sign),
    ]
    if shows_pressures(plant, s):
        dP, drop = pressure_difference(plant, s), "the pressure difference"
        loss = sign[:, None] * hats(np.abs(dP), 6)
        found.append(Regressors("loss", f"the size of {drop}, {against}", "Pa", np.abs(dP), loss, sign=sign))
        found.append(Regressors("pressure", drop, "Pa", dP, hats(dP, 10)))
    return found


def flow_regressors(plant: Plant, s: BalanceSignals, name: str, orders: tuple[float, ...]) -> list[Regressors]:
    """Regressors of an unknown flow into a chamber."""
    pressure, chamber = plant.structure.system.entries[name].target, name[-1]
    P, rate = s[pressure][:-1], s[f"{pressure}_rate"][:-1]
    shaft, rod, dP = balance_contact(plant, "torque"), balance_contact(plant, "force"), pressure_difference(plant, s)
    omega, x, v, time = (s[n][:-1] for n in (shaft.velocity, rod.position, rod.velocity, "time"))
    here, speed, drop = f"the pressure in chamber {chamber}", "the shaft's speed", "the pressure difference"
    pumped, leak = omega * np.abs(dP), dP[:, None] * hats(time, 8)
    found = [
        Regressors("constant", "time", "s", time, np.ones((P.size, 1))),
        Regressors("linear", drop, "Pa", dP, dP[:, None]),
        Regressors("pressure", drop, "Pa", dP, hats(dP, 14)),
        Regressors("level", here, "Pa", P, hats(P, 14)),
        Regressors("speed", speed, "rad/s", omega, hats(omega, 13)),
        Regressors("linear", speed, "rad/s", omega, omega[:, None]),
        Regressors("rate", f"the rate of {here}", "Pa/s", rate, rate[:, None]),
        Regressors("softness", f"{here}, times its rate", "Pa", P, rate[:, None] * hats(P, 6)),
        Regressors("volume", f"the rod's position, times the rate of {here}", "m", x, rate[:, None] * hats(x, 5)),
        Regressors("linear", "the rod's speed", "m/s", v, v[:, None]),
        Regressors("time", "time", "s", time, hats(time, 14)),
        Regressors("pressure in time", f"time, with {drop}", "s", time, leak, sign=np.sign(dP)),
        Regressors("pumped", f"{speed} times the size of {drop}", "rad/s Pa", pumped, pumped[:, None]),
    ]
    for order in orders:
        wave = _ripple(shaft_angle(plant, s), order)
        columns = np.column_stack([wave.columns, omega[:, None] * wave.columns])
        found.append(replace(wave, columns=columns))
    return found


def _ripple(angle: np.ndarray, order: float) -> Regressors:
    columns = np.column_stack([np.sin(order * angle), np.cos(order * angle)])
    turn = np.mod(angle, 2.0 * np.pi / order)
    return Regressors("ripple", f"the shaft's angle, {order:g} a turn", "rad", turn, columns, False, order)
