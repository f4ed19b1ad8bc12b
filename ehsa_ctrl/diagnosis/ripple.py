"""The orders of a torque ripple that the torque balance shows, angle by angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from ..core.log import Log
from ..plant.plant import Plant
from .twin import Twin


def strongest_orders(plant: Plant, log: Log, count: int = 3) -> list[tuple[float, float, float]]:
    """(periods a turn, amplitude [N m], phase [rad]) of the strongest ripples, the largest first.

    The torque balance's residual, K_T I - J_M domega/dt - D dP less dry and viscous friction, is projected on sine
    and cosine of each order of the shaft's angle, which is the integral of the measured speed.
    """
    dt, omega = log.sample_time, log["speed"]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * dt])
    torque = plant["K_T"] * uniform_filter1d(log["current"], 3) - plant["J_M"] * np.gradient(
        uniform_filter1d(omega, 3), dt
    )
    if {"p1", "p2"} <= set(log.channels):
        torque = torque - plant["D"] * (log["p1"] - log["p2"])
    moves = np.abs(omega) > 3.0
    basis = np.column_stack([np.sign(omega), omega, np.ones_like(omega), log["current"]])[moves]
    residual = torque[moves] - basis @ np.linalg.lstsq(basis, torque[moves], rcond=None)[0]
    orders = np.arange(1.0, 49.0)
    found = []
    for order in orders:
        wave = np.column_stack([np.sin(order * angle[moves]), np.cos(order * angle[moves])])
        a, b = np.linalg.lstsq(wave, residual, rcond=None)[0]
        # What the balance lacks is what the ripple gives.
        found.append((float(order), float(np.hypot(a, b)), float(np.arctan2(-b, -a))))
    return sorted(found, key=lambda row: -row[1])[:count]


#: Multiples of the amplitude that the balance shows: what turns fast is smoothed away in it.
AMPLITUDES = (1.0, 2.0, 4.0, 6.0)
#: Stretches from the start of a log over which a ripple is followed, each starting where the one before ended [s].
STRETCHES = (1.0, 2.0, 4.0, 8.0)
PHASES = 12


def followed(twin: Twin, order: float, amplitude: float) -> tuple[float, float]:
    """Amplitude [N m] and phase [rad] of a ripple of known order, from the start of a log on.

    A free run that is wrong by a turn says nothing of a phase, so that the first second is looked at alone and what
    is found is followed over longer and longer stretches.
    """
    values = np.array([amplitude, 0.0])
    for number, length in enumerate(STRETCHES):
        samples = min(int(round(length / twin.log.sample_time)), len(twin.log))
        short = replace(twin, log=twin.log.rows(0, samples))
        scale = {c: max(float(np.std(short.log[c])), 1e-12) for c in ("speed", "p1", "p2") if c in short.log.channels}

        def residual(point: np.ndarray, short: Twin = short, scale: dict[str, float] = scale) -> np.ndarray:
            run = short.run([{"T_c": max(float(point[0]), 0.0), "n_c": order, "phi_c": float(point[1])}])[0]
            if run is None:
                return np.full(len(short.log) * len(scale), 10.0)
            return np.concatenate([(run[c] - short.log[c]) / s for c, s in scale.items()])

        if number == 0:
            grid = [
                np.array([a * amplitude, phase])
                for a in AMPLITUDES
                for phase in np.linspace(0.0, 2.0 * np.pi, PHASES, endpoint=False)
            ]
            values = min(grid, key=lambda point: float(np.sum(residual(point) ** 2)))
        found = least_squares(
            residual, values, x_scale=[0.1 * amplitude, 0.1], diff_step=[1e-2, 1e-2], max_nfev=8, loss="soft_l1"
        )
        values = found.x
        if samples == len(twin.log):
            break
    return max(float(values[0]), 0.0), float((values[1] + np.pi) % (2.0 * np.pi) - np.pi)
