"""The shaft angle of a log, and the torque ripple over this angle in the torque balance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...core.log import Log

#: Orders that are searched, periods per turn. Engineering judgement: cogging and gear teeth have no higher ones.
ORDERS = np.arange(1.0, 49.0)
#: Speed [rad/s] below which Stribeck friction differs too much from Coulomb friction. Engineering judgement.
SLOW = 3.0
#: Number of samples in motion that a log needs. Engineering judgement.
MIN_SAMPLES = 100
#: Length of a window in which the phase is estimated [s], and the share of it that must be in motion. Windows of twice
#: the length resolve the drift of the integral too coarsely; with half of it, the noise of a phase is as large as the
#: drift.
WINDOW, MOVING = 1.0, 0.3
#: Ratio of explained variance from which the strongest order is dominant over the next. Engineering judgement.
DOMINANT = 2.0
#: The channel with the shaft angle [rad] that is added to a log.
ANGLE = "angle"


def strongest_orders(plant: Mapping[str, float], log: Log, count: int = 3) -> list[tuple[float, float, float]]:
    """(periods per turn, amplitude [N m], phase [rad]) of the ripples that explain most of the residual, in that order.

    The residual torque over a sample is projected on the means of sine and cosine of each order over that sample: at
    300 rad/s, a ripple with four periods per turn passes through one period in 5 ms, and a balance at the sample times,
    or a smoothed one, would make it many times too small. Empty for a log with little motion.
    """
    log = _with_integral(log)
    return [row for _, row in _ranked_orders(log, *_closing_torque(plant, log))[:count]]


def with_angle(plant: Mapping[str, float], log: Log, like: Log | None = None) -> Log:
    """The log with the shaft angle as a channel: the integral of the measured speed, from zero.

    The noise of a speed sensor makes this integral drift, by some 0.1 rad in 20 s, which is much for a ripple with many
    periods per turn. If one order is dominant in the torque balance, the angle is corrected to make its phase constant.

    The absolute angle is unknown. If the nominal plant has a ripple, the initial angle gives the ripple of this log
    that phase; with a log `like`, it gives both logs the same phase.
    """
    if "speed" not in log.channels:
        return log
    log = _with_integral(log)
    moves, residual = _closing_torque(plant, log)
    nominal = plant.get("T_c", 0.0) > 0.0
    order = plant["n_c"] if nominal else _dominant_order(log, moves, residual)
    if order is None or np.count_nonzero(moves) < MIN_SAMPLES:
        return log
    log = _phase_corrected(log, order, moves, residual)
    wanted = plant["phi_c"] if nominal else None
    if wanted is None and like is not None and ANGLE in like.channels:
        there, its_residual = _closing_torque(plant, like)
        wanted = _phase(like, order, np.flatnonzero(there), its_residual) if there.any() else None
    if wanted is None:
        return log
    return _advanced(log, (_phase(log, order, np.flatnonzero(moves), residual) - wanted) / order)


def _dominant_order(log: Log, moves: np.ndarray, residual: np.ndarray) -> float | None:
    """The order that explains DOMINANT times as much of the residual torque as any other; None if none does."""
    ranked = _ranked_orders(log, moves, residual)
    return ranked[0][1][0] if ranked and ranked[0][0] >= DOMINANT * ranked[1][0] else None


def _phase_corrected(log: Log, order: float, moves: np.ndarray, residual: np.ndarray) -> Log:
    """The log with its angle corrected so that the ripple has the same phase in every window."""
    length = max(int(round(WINDOW / log.sample_time)), 1)
    times, phases = [], []
    for first in range(0, max(len(residual) - length // 2, 1), max(length // 2, 1)):
        part = slice(first, first + length)
        if np.count_nonzero(moves[part]) < MOVING * length:
            continue
        times.append(log.time[0] + (first + 0.5 * min(length, len(residual) - first)) * log.sample_time)
        phases.append(_phase(log, order, part.start + np.flatnonzero(moves[part]), residual))
    if len(times) < 2:
        return log
    drift = np.interp(log.time, times, np.unwrap(phases))
    return _advanced(log, (drift - drift[0]) / order)


def _advanced(log: Log, angle: np.ndarray | float) -> Log:
    """The log with the angle advanced by `angle` [rad]."""
    return replace(log, channels={**log.channels, ANGLE: log[ANGLE] + angle})


def _phase(log: Log, order: float, samples: np.ndarray, residual: np.ndarray) -> float:
    """Phase [rad] of the ripple of this order in these samples."""
    waves = np.column_stack([over_samples(log, order, 0.0), over_samples(log, order, 0.5 * np.pi)])[samples]
    a, b = np.linalg.lstsq(waves, residual[samples], rcond=None)[0]
    return float(np.arctan2(b, a))


def over_samples(log: Log, order: float, phase: float) -> np.ndarray:
    """Mean of sin(order theta + phase) over each sample (N - 1,) of a log with an angle.

    Exact for a speed that is constant within a sample.
    """
    turned = np.diff(log[ANGLE])
    middle = log[ANGLE][:-1] + 0.5 * turned
    return np.asarray(np.sin(order * middle + phase) * np.sinc(order * turned / (2.0 * np.pi)))


def ripple_current(values: Mapping[str, float], log: Log) -> np.ndarray:
    """The current (N,) whose torque is the ripple at the log's angle."""
    wave = over_samples(log, values["n_c"], values["phi_c"])
    return np.asarray(values["T_c"] / values["K_T"] * np.append(wave, 0.0))


def angle_of(log: Log) -> np.ndarray:
    """The angle channel (N,) [rad] of a log, or else the integral of its measured speed; zero without a speed."""
    if ANGLE in log.channels:
        return log[ANGLE]
    if "speed" not in log.channels:
        return np.zeros(len(log))
    omega = log["speed"]
    return np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * log.sample_time])


def _with_integral(log: Log) -> Log:
    return replace(log, channels={**log.channels, ANGLE: angle_of(log)})


def _closing_torque(plant: Mapping[str, float], log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Samples in motion (N - 1,), and residual of the torque balance over each sample (N - 1,) [N m]."""
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
    # Remove errors of the nominal parameters and the shape of friction near standstill, but no error of the inertia,
    # because the ripple accelerates the shaft.
    known = [direction, mean, np.ones_like(mean), log["current"][:-1]]
    basis = np.column_stack([*known, direction * np.exp(-size / 10.0), direction * np.exp(-size / 40.0)])
    return moves, torque - basis @ np.linalg.lstsq(basis[moves], torque[moves], rcond=None)[0]


def _ranked_orders(log: Log, moves: np.ndarray, residual: np.ndarray) -> list[tuple[float, tuple[float, float, float]]]:
    """Sum of squares that each order explains [(N m)2], with (order, amplitude, phase), the largest first."""
    if np.count_nonzero(moves) < MIN_SAMPLES:
        return []
    found = []
    for order in ORDERS:
        wave = np.column_stack([over_samples(log, order, 0.0), over_samples(log, order, 0.5 * np.pi)])[moves]
        a, b = np.linalg.lstsq(wave, residual[moves], rcond=None)[0]
        explained = float(np.sum((wave @ np.array([a, b])) ** 2))
        found.append((explained, (float(order), float(np.hypot(a, b)), float(np.arctan2(b, a)))))
    return sorted(found, key=lambda pair: -pair[0])
