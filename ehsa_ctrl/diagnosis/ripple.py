"""The orders of a torque ripple that the torque balance shows, angle by angle."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from ..core.log import Log
from ..plant.plant import Plant


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
