"""The shaft angle of a log, and the torque ripple over this angle in the torque balance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
#: Ratio of explained variance from which the strongest order, or the two strongest, are dominant over the next.
#: Engineering judgement.
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


def two_waves(plant: Mapping[str, float], log: Log) -> list[tuple[float, float, float]]:
    """(periods per turn, amplitude [N m], phase [rad]) of two ripples, fitted together, the stronger order first.

    Empty unless the second order stands out from all others as well.
    """
    log = _with_integral(log)
    moves, residual = _closing_torque(plant, log)
    ranked = _ranked_orders(log, moves, residual)
    if not _second_stands_out(ranked):
        return []
    orders = [row[0] for _, row in ranked[:2]]
    return [(order, *polar) for order, polar in zip(orders, _polar(log, orders, moves, residual), strict=True)]


def with_angle(plant: Mapping[str, float], log: Log, like: Log | None = None) -> Log:
    """The log with the shaft angle as a channel: the integral of the measured speed, from zero.

    The noise of a speed sensor makes this integral drift, by some 0.1 rad in 20 s, which is much for a ripple with many
    periods per turn. If one order is dominant in the torque balance, the angle is corrected to make its phase constant.

    The absolute angle is unknown. If the nominal plant has a ripple, the initial angle gives the ripple of this log
    that phase; with a log `like`, it gives both logs the same phase. An order fixes the angle up to a period; a second
    one decides which period it is.
    """
    if "speed" not in log.channels:
        return log
    log = _with_integral(log)
    moves, residual = _closing_torque(plant, log)
    nominal = plant.get("T_c", 0.0) > 0.0
    orders = _nominal_orders(plant) if nominal else _dominant_orders(log, moves, residual)
    if not orders or np.count_nonzero(moves) < MIN_SAMPLES:
        return log
    log = _phase_corrected(log, orders, moves, residual)
    wanted = [plant["phi_c"], plant["phi_c2"]][: len(orders)] if nominal else None
    if wanted is None and like is not None and ANGLE in like.channels:
        there, its_residual = _closing_torque(plant, like)
        wanted = _phases(like, orders, there, its_residual) if there.any() else None
    if wanted is None:
        return log
    return _advanced(log, _turn(orders, _phases(log, orders, moves, residual), wanted))


def _nominal_orders(plant: Mapping[str, float]) -> list[float]:
    """The orders of a plant's own ripple."""
    return [plant["n_c"]] + ([plant["n_c2"]] if plant["a_c2"] != 0.0 else [])


def _turn(orders: Sequence[float], phases: Sequence[float], wanted: Sequence[float]) -> float:
    """The angle [rad] by which a log is to be advanced, so that its ripples have the wanted phases."""
    turns = (phases[0] - wanted[0] + 2.0 * np.pi * np.arange(max(round(orders[0]), 1))) / orders[0]
    if len(orders) == 1:
        return float(turns[0])
    off = phases[1] - wanted[1] - orders[1] * turns
    return float(turns[np.argmax(np.cos(off))])


def _dominant_orders(log: Log, moves: np.ndarray, residual: np.ndarray) -> list[float]:
    """The order that explains DOMINANT times as much of the residual torque as any other, or the two that do."""
    ranked = _ranked_orders(log, moves, residual)
    if not ranked:
        return []
    if _second_stands_out(ranked):
        return [row[0] for _, row in ranked[:2]]
    return [ranked[0][1][0]] if ranked[0][0] >= DOMINANT * ranked[1][0] else []


def _second_stands_out(ranked: Sequence[tuple[float, tuple[float, float, float]]]) -> bool:
    """Whether the second order explains DOMINANT times as much as the third."""
    return bool(ranked) and ranked[1][0] >= DOMINANT * ranked[2][0]


def _phase_corrected(log: Log, orders: Sequence[float], moves: np.ndarray, residual: np.ndarray) -> Log:
    """The log with its angle corrected so that the ripple of the first order has the same phase in every window."""
    length = max(int(round(WINDOW / log.sample_time)), 1)
    times, phases = [], []
    for first in range(0, max(len(residual) - length // 2, 1), max(length // 2, 1)):
        part = slice(first, first + length)
        if np.count_nonzero(moves[part]) < MOVING * length:
            continue
        times.append(log.time[0] + (first + 0.5 * min(length, len(residual) - first)) * log.sample_time)
        inside = np.zeros_like(moves)
        inside[part] = moves[part]
        phases.append(_phases(log, orders, inside, residual)[0])
    if len(times) < 2:
        return log
    drift = np.interp(log.time, times, np.unwrap(phases))
    return _advanced(log, (drift - drift[0]) / orders[0])


def _advanced(log: Log, angle: np.ndarray | float) -> Log:
    """The log with the angle advanced by `angle` [rad]."""
    return replace(log, channels={**log.channels, ANGLE: log[ANGLE] + angle})


def _phases(log: Log, orders: Sequence[float], samples: np.ndarray, residual: np.ndarray) -> list[float]:
    """Phase [rad] of the ripple of each order in these samples (N - 1,)."""
    return [phase for _, phase in _polar(log, orders, samples, residual)]


def _polar(log: Log, orders: Sequence[float], samples: np.ndarray, residual: np.ndarray) -> list[tuple[float, float]]:
    """(amplitude [N m], phase [rad]) of the ripple of each order, fitted together to these samples (N - 1,)."""
    waves = np.column_stack([over_samples(log, n, turn) for n in orders for turn in (0.0, 0.5 * np.pi)])[samples]
    found = np.linalg.lstsq(waves, residual[samples], rcond=None)[0].reshape(-1, 2)
    return [(float(np.hypot(a, b)), float(np.arctan2(b, a))) for a, b in found]


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
    if values["a_c2"] != 0.0:
        wave = wave + values["a_c2"] * over_samples(log, values["n_c2"], values["phi_c2"])
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
