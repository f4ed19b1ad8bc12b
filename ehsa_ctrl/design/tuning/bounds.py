"""Bounds that a tuned loop keeps: peaks of its sensitivity functions, noise gain, crossover.

Every bound becomes smooth numbers log(allowed / found), at least 0 where the bound holds. A peak is the largest value
of a band of frequencies, refined by a parabola, so that its derivative is that of the true peak; with one number a
band the optimiser sees all peaks of a loop and not only the one that happens to be largest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..laws.pid_forms import Gains
from .loop import Loop, SampledPlant

#: Points of the frequency grid, decades below the Nyquist frequency, and bands.
POINTS, DECADES, BANDS = 360, 5.0, 9
#: Bounds that are least values; the others are largest ones.
LEAST = ("disk_margin", "crossover")


@dataclass(frozen=True)
class Bounds:
    """What is asked of the loop, broken at the current; None asks nothing.

    Attributes
    ----------
    Ms, Mt: largest |S| and |T|.
    disk_margin: least balanced disk margin, 2 / max |S - T| (P. Seiler, A. Packard, P. Gahinet, "An Introduction to
        Disk Margins", IEEE Control Systems Magazine 40(5), 2020).
    noise_gain: largest RMS current per RMS of white position noise [A/m].
    crossover: least frequency at which the loop gain is still 1 [rad/s].
    """

    Ms: float | None = None
    Mt: float | None = None
    disk_margin: float | None = None
    noise_gain: float | None = None
    crossover: float | None = None

    def asked(self) -> dict[str, float]:
        names = ("Ms", "Mt", "disk_margin", "noise_gain", "crossover")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True)
class Judge:
    """Judges gains on one plant against bounds."""

    plant: SampledPlant
    bounds: Bounds

    @cached_property
    def grid(self) -> np.ndarray:
        """Frequencies (m,) [rad/s] up to the Nyquist frequency."""
        return np.pi / self.plant.sample_time * np.logspace(-DECADES, 0.0, POINTS)

    @cached_property
    def z(self) -> np.ndarray:
        return np.exp(1j * self.grid * self.plant.sample_time)

    @cached_property
    def G(self) -> np.ndarray:
        return self.plant.response(self.z)

    @cached_property
    def crossing(self) -> tuple[np.ndarray, np.ndarray]:
        z = np.exp(1j * np.array([self.bounds.crossover]) * self.plant.sample_time)
        return z, self.plant.response(z)

    def room(self, gains: Gains) -> np.ndarray:
        """log(allowed / found) of all bounds, some numbers each, and last the room to instability."""
        b = self.bounds
        C = gains.response(self.z, self.plant.sample_time)
        S = 1.0 / (1.0 + C * self.G)
        sizes, allowed = [], []
        if b.Ms is not None:
            sizes.append(np.abs(S))
            allowed.append(b.Ms)
        if b.Mt is not None:
            sizes.append(np.abs(1.0 - S))
            allowed.append(b.Mt)
        if b.disk_margin is not None:
            sizes.append(np.abs(2.0 * S - 1.0))
            allowed.append(2.0 / b.disk_margin)
        peaks = band_peaks(np.log(np.array(sizes) + 1e-9))
        rows = [(np.log(allowed)[:, None] - peaks).ravel()]
        if b.noise_gain is not None:
            mean = np.trapezoid(np.abs(C * S) ** 2, self.grid * self.plant.sample_time) / np.pi
            rows.append(np.array([np.log(b.noise_gain) - 0.5 * np.log(max(mean, 1e-300))]))
        if b.crossover is not None:
            z, G = self.crossing
            rows.append(np.log(np.abs(gains.response(z, self.plant.sample_time) * G)))
        rows.append(np.array([10.0 * (1.0 - Loop(self.plant, gains).radius())]))
        return np.concatenate(rows)


def band_peaks(values: np.ndarray) -> np.ndarray:
    """Largest value (..., BANDS) of each band of a grid (..., POINTS); a peak between points is that of a parabola."""
    flat = values.reshape(-1, POINTS)
    width = POINTS // BANDS
    inside = np.argmax(flat.reshape(-1, BANDS, width), axis=2)
    k = inside + width * np.arange(BANDS)
    rows = np.arange(flat.shape[0])[:, None]
    middle = np.clip(k, 1, POINTS - 2)
    left, peak, right = flat[rows, middle - 1], flat[rows, middle], flat[rows, middle + 1]
    bend = left - 2.0 * peak + right
    true = (middle == k) & (left <= peak) & (peak >= right) & (bend < 0.0)
    refined = peak - np.where(true, (right - left) ** 2 / (8.0 * np.where(true, bend, -1.0)), 0.0)
    return np.where(true, refined, flat[rows, k]).reshape(*values.shape[:-1], BANDS)
