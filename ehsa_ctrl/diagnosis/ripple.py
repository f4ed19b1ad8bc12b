"""A torque ripple as the torque balance shows it, angle by angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.log import Log
from ..plant.plant import Plant

#: Orders that are looked for, periods a turn.
ORDERS = np.arange(1.0, 49.0)
#: Below this speed [rad/s] dry friction is more than a sign.
SLOW = 3.0
#: Samples in motion that a log needs.
ENOUGH = 100
#: Length of a window in which a ripple's phase is read [s], and the part of it that has to be in motion. At twice the
#: length the walk of the integral is seen too coarsely, at half of it the noise of each phase is as large.
WINDOW, SEEN = 1.0, 0.3
#: The strongest order stands out if it explains this much more than the next one.
PLAIN = 2.0
#: The channel with the shaft's angle [rad] that a log is given for this.
ANGLE = "angle"


def strongest_orders(plant: Plant, log: Log, count: int = 3) -> list[tuple[float, float, float]]:
    """(periods a turn, amplitude [N m], phase [rad]) of the ripples that explain most, the largest part first.

    The torque that the balance lacks over a sample is projected on the means of sine and cosine of each order over that
    sample: at 300 rad/s a ripple of four a turn goes through a whole period in 5 ms, so that a balance at the samples,
    or a smoothed one, would find it many times too small. None for a log that hardly moves.
    """
    log = _turning(log)
    return [row for _, row in _ranked(log, *_lacking(plant, log))[:count]]


def with_angle(plant: Plant, log: Log, like: Log | None = None) -> Log:
    """The log with the shaft's angle as a channel: the integral of the measured speed, zero where the log begins.

    The noise of a speed sensor walks away in that integral, some 0.1 rad in 20 s, which is much for a ripple of many
    periods a turn. Where one order stands out in the torque balance, the angle is what keeps its phase.

    Nobody knows how the shaft stood when a log began. Where the plant has a ripple already, the angle begins so that
    this log's ripple is in that one's phase; and with a log that it should be like, so that both are in one phase.
    """
    if "speed" not in log.channels:
        return log
    log = _turning(log)
    moves, lacks = _lacking(plant, log)
    in_plant = ripple_of(plant) > 0.0
    order = plant["n_c"] if in_plant else _plain_order(log, moves, lacks)
    if order is None or np.count_nonzero(moves) < ENOUGH:
        return log
    log = _kept_in_phase(log, order, moves, lacks)
    wanted = plant["phi_c"] if in_plant else None
    if wanted is None and like is not None and ANGLE in like.channels:
        there, lacking = _lacking(plant, like)
        wanted = _phase(like, order, np.flatnonzero(there), lacking) if there.any() else None
    if wanted is None:
        return log
    return _ahead(log, (_phase(log, order, np.flatnonzero(moves), lacks) - wanted) / order)


def _plain_order(log: Log, moves: np.ndarray, lacks: np.ndarray) -> float | None:
    """The order that explains plainly more of what the balance lacks than any other; None if none does."""
    ranked = _ranked(log, moves, lacks)
    return ranked[0][1][0] if ranked and ranked[0][0] >= PLAIN * ranked[1][0] else None


def _kept_in_phase(log: Log, order: float, moves: np.ndarray, lacks: np.ndarray) -> Log:
    """The log with an angle in which a ripple keeps its phase from window to window."""
    length = max(int(round(WINDOW / log.sample_time)), 1)
    times, phases = [], []
    for first in range(0, max(len(lacks) - length // 2, 1), max(length // 2, 1)):
        part = slice(first, first + length)
        if np.count_nonzero(moves[part]) < SEEN * length:
            continue
        times.append(log.time[0] + (first + 0.5 * min(length, len(lacks) - first)) * log.sample_time)
        phases.append(_phase(log, order, part.start + np.flatnonzero(moves[part]), lacks))
    if len(times) < 2:
        return log
    drift = np.interp(log.time, times, np.unwrap(phases))
    return _ahead(log, (drift - drift[0]) / order)


def ripple_of(plant: Plant) -> float:
    """The amplitude of the ripple that a plant has already [N m]."""
    return plant.parameters["T_c"].value if "T_c" in plant.parameters else 0.0


def _ahead(log: Log, angle: np.ndarray | float) -> Log:
    """The log with a shaft that stands so much further [rad]."""
    return replace(log, channels={**log.channels, ANGLE: log[ANGLE] + angle})


def _phase(log: Log, order: float, samples: np.ndarray, lacks: np.ndarray) -> float:
    """Phase [rad] of the ripple of this order in those samples."""
    waves = np.column_stack([over_samples(log, order, 0.0), over_samples(log, order, 0.5 * np.pi)])[samples]
    a, b = np.linalg.lstsq(waves, lacks[samples], rcond=None)[0]
    return float(np.arctan2(b, a))


def over_samples(log: Log, order: float, phase: float) -> np.ndarray:
    """Mean of sin(order theta + phase) over each sample (N - 1,) of a log with an angle.

    Exact for a speed that is constant within a sample.
    """
    turned = np.diff(log[ANGLE])
    middle = log[ANGLE][:-1] + 0.5 * turned
    return np.asarray(np.sin(order * middle + phase) * np.sinc(order * turned / (2.0 * np.pi)))


def angle_of(log: Log) -> np.ndarray:
    """The shaft's angle (N,) [rad] that a log has been given, or the integral of its measured speed."""
    if ANGLE in log.channels:
        return log[ANGLE]
    omega = log["speed"]
    return np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * log.sample_time])


def _turning(log: Log) -> Log:
    return replace(log, channels={**log.channels, ANGLE: angle_of(log)})


def _lacking(plant: Plant, log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Which samples move (N - 1,), and the torque that the balance lacks over each."""
    dt, omega = log.sample_time, log["speed"]
    mean = 0.5 * (omega[1:] + omega[:-1])
    torque = plant["J_M"] * np.diff(omega) / dt - plant["K_T"] * log["current"][:-1]
    if {"p1", "p2"} <= set(log.channels):
        dP = log["p1"] - log["p2"]
        torque = torque + plant["D"] * 0.5 * (dP[1:] + dP[:-1])
    moves = np.abs(mean) > SLOW
    if not moves.any():
        return moves, torque
    direction, size = np.sign(mean), np.abs(mean)
    # What the nominal parameters could be wrong by, and what a friction curve bends near standstill. Not the inertia:
    # a ripple is what accelerates the shaft, and would be taken for it.
    known = [direction, mean, np.ones_like(mean), log["current"][:-1]]
    basis = np.column_stack([*known, direction * np.exp(-size / 10.0), direction * np.exp(-size / 40.0)])
    return moves, torque - basis @ np.linalg.lstsq(basis[moves], torque[moves], rcond=None)[0]


def _ranked(log: Log, moves: np.ndarray, lacks: np.ndarray) -> list[tuple[float, tuple[float, float, float]]]:
    """What each order explains [(N m)2, summed], and (order, amplitude, phase), the best first."""
    if np.count_nonzero(moves) < ENOUGH:
        return []
    found = []
    for order in ORDERS:
        wave = np.column_stack([over_samples(log, order, 0.0), over_samples(log, order, 0.5 * np.pi)])[moves]
        a, b = np.linalg.lstsq(wave, lacks[moves], rcond=None)[0]
        explained = float(np.sum((wave @ np.array([a, b])) ** 2))
        found.append((explained, (float(order), float(np.hypot(a, b)), float(np.arctan2(b, a)))))
    return sorted(found, key=lambda pair: -pair[0])
