"""How far a sampled loop is from instability: gain, phase, delay and disk margins, and peaks of S and T.

The loop gain L(e^{i w h}) is given as a function of frequency; S = 1 / (1 + L), T = L / (1 + L).

The disk margin is the balanced one of P. Seiler, A. Packard, P. Gahinet, "An introduction to disk margins", IEEE
Control Systems Magazine 40(5), 2020: the loop stays stable for every complex factor (2 + d) / (2 - d) with
|d| < alpha on its gain, and alpha = 1 / max |S - 1/2|. It bounds gain and phase changes that come together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, inf, nan

import numpy as np

Gain = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Peak:
    """The largest value of a curve and its frequency [rad/s]."""

    value: float
    frequency: float


def frequencies(sample_time: float, poles: np.ndarray, *, points: int) -> np.ndarray:
    """Where to look at a sampled loop: (n,) rad/s, up to pi / sample_time, dense where a pole can make a narrow peak.

    poles: of open and closed loop, in z. A pole at a distance s from the unit circle (seen in ln z / sample_time) makes
    a peak of about that width at its own frequency; ten points are put around each, none on the pole itself.
    """
    nyquist = np.pi / sample_time
    own = poles[np.abs(poles) > 1e-3]
    place = np.log(own.astype(complex)) / sample_time
    slowest = np.min(np.abs(place), initial=nyquist, where=np.abs(place) > 1e-9 * nyquist)
    grid = [np.geomspace(min(1e-2 * slowest, 1e-3 * nyquist), nyquist, points)]
    resonant = place[np.abs(place.real) < 0.3 * np.abs(place.imag)]
    grid += [abs(p.imag) + max(abs(p.real), 1e-9 * abs(p.imag)) * np.linspace(-2.0, 2.0, 10) for p in resonant]
    every = np.unique(np.concatenate(grid))
    return every[(every > 0) & (every <= nyquist)]


def peak(curve: Gain, omega: np.ndarray, values: np.ndarray) -> Peak:
    """The largest value of a curve, from its values (n,) on a grid, found between the grid's points.

    Every local maximum of the grid that reaches nine tenths of the largest is closed in on.
    """
    best = Peak(float(np.max(values)), float(omega[int(np.argmax(values))]))
    before, after = np.r_[-inf, values[:-1]], np.r_[values[1:], -inf]
    tops = (values >= before) & (values >= after) & (values >= 0.9 * best.value)
    for k in map(int, np.flatnonzero(tops)):
        low, high = omega[max(k - 1, 0)], omega[min(k + 1, omega.size - 1)]
        for _ in range(5):
            inner = np.linspace(low, high, 17)
            found = curve(inner)
            at = int(np.argmax(found))
            if found[at] > best.value:
                best = Peak(float(found[at]), float(inner[at]))
            low, high = inner[max(at - 1, 0)], inner[min(at + 1, 16)]
    return best


def _crossings(function: Callable[[float], float], omega: np.ndarray, values: np.ndarray) -> list[float]:
    """Frequencies at which a curve, known on a grid, goes through zero."""
    from scipy.optimize import brentq

    found = [float(w) for w in omega[values == 0.0]]
    for k in np.flatnonzero(values[1:] * values[:-1] < 0.0):
        found.append(float(brentq(function, omega[k], omega[k + 1], xtol=1e-12, rtol=1e-12)))
    return sorted(found)


@dataclass(frozen=True)
class Margins:
    """Margins of a stable loop; all nan for one that is not stable, but for the disk margin, which is 0 then.

    Attributes
    ----------
    crossover: frequency [rad/s] of the crossover with the least phase margin; nan without any.
    phase_margin: deg, the least at any crossover, lag or lead; inf without a crossover.
    gain_margin: smallest factor above 1 on the gain that brings the loop to the brink; gain_reduction: largest below 1.
    gain_frequency: rad/s, where the gain margin is: its phase there is -180 deg; nan without any.
    delay_margin: s, extra delay that brings it there, from the phase at the crossovers; inf without a crossover.
    Ms, Mt: peaks of |S| and |T|. disk_margin: alpha. disk_frequency: rad/s, where the disk is touched.
    """

    crossover: float
    phase_margin: float
    gain_margin: float
    gain_reduction: float
    delay_margin: float
    Ms: float
    Mt: float
    disk_margin: float
    disk_frequency: float
    gain_frequency: float = nan


def margins(
    gain: Gain, omega: np.ndarray, response: np.ndarray, *, static: float = inf, stable: bool = True
) -> Margins:
    """Margins of a loop from its gain on a grid, refined between the grid's points.

    Parameters
    ----------
    gain: L at frequencies [rad/s], (n,) -> (n,) complex.
    omega: (n,) rad/s as `frequencies` gives them, the last one pi over the sample time. response: (n,) the gain there.
    static: the gain at standstill, inf with an integrator.
    stable: whether the closed loop is; the curves can't tell.
    """

    def at(w: float) -> complex:
        return complex(gain(np.array([w]))[0])

    sensitivity = peak(lambda w: np.abs(1 / (1 + gain(w))), omega, np.abs(1 / (1 + response)))
    complementary = peak(lambda w: np.abs(1 - 1 / (1 + gain(w))), omega, np.abs(response / (1 + response)))
    if not stable:
        return Margins(nan, nan, nan, nan, nan, sensitivity.value, complementary.value, 0.0, nan)
    disk = peak(lambda w: np.abs(1 / (1 + gain(w)) - 0.5), omega, np.abs(1 / (1 + response) - 0.5))
    phase, delay, crossover = inf, inf, nan
    for w in _crossings(lambda w: float(np.log(abs(at(w)))), omega, np.log(np.abs(response))):
        here = np.angle(-at(w))
        if abs(here) < phase:
            phase, crossover = float(abs(here)), w
        delay = min(delay, float(here % (2 * np.pi)) / w)
    # On the last point, z = -1, the gain is real: the loop can lose stability there without a change of sign before it.
    inner = slice(None, -1)
    real = _crossings(lambda w: at(w).imag, omega[inner], response[inner].imag)
    edges = [(at(w).real, w) for w in real] + [(float(response[-1].real), float(omega[-1]))]
    edges += [(static, 0.0)] if np.isfinite(static) else []
    factors = [(-1 / edge, w) for edge, w in edges if edge < 0]
    gain_margin, gain_frequency = min((one for one in factors if one[0] > 1), default=(inf, nan))
    return Margins(
        crossover=crossover,
        phase_margin=float(np.degrees(phase)),
        gain_margin=gain_margin,
        gain_reduction=max((factor for factor, _ in factors if factor < 1), default=0.0),
        delay_margin=delay,
        Ms=sensitivity.value,
        Mt=complementary.value,
        disk_margin=1 / disk.value,
        disk_frequency=disk.frequency,
        gain_frequency=gain_frequency,
    )


def disk_range(alpha: float) -> tuple[float, float, float]:
    """What a disk margin alpha guarantees alone: lowest and highest factor on the gain, and phase [deg].

    (2 - alpha) / (2 + alpha), its inverse, and 2 atan(alpha / 2) (Seiler, Packard, Gahinet 2020).
    """
    low = max((2 - alpha) / (2 + alpha), 0.0)
    return low, 1 / low if low > 0 else inf, float(np.degrees(2 * atan(min(alpha, 2.0) / 2)))
