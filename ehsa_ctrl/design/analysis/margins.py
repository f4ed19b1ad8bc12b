"""Stability margins of a sampled loop: gain, phase, delay and disk margins, peaks of S and T.

The loop gain L(e^{i w h}) is a function of frequency; S = 1 / (1 + L), T = L / (1 + L). python-control's
stability_margins interpolates on its grid; here L itself is evaluated between its points.

The disk margin is the balanced one of P. Seiler, A. Packard, P. Gahinet, "An introduction to disk margins", IEEE
Control Systems Magazine 40(5), 2020: the loop stays stable for every complex factor (2 + d) / (2 - d) with
|d| < alpha on its gain, and alpha = 1 / max |S - 1/2|. It covers simultaneous changes of gain and phase.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, inf, nan

import numpy as np

LoopGain = Callable[[np.ndarray], np.ndarray]


def frequency_grid(sample_time: float, poles: np.ndarray, *, points: int) -> np.ndarray:
    """Frequencies (n,) [rad/s] up to pi / sample_time, dense around resonances.

    poles: of open and closed loop, in z. A pole p = ln z / sample_time causes a peak at |Im p| about |Re p| wide; ten
    points surround each, none of them on the pole itself.
    """
    nyquist = np.pi / sample_time
    continuous = np.log(poles[np.abs(poles) > 1e-3].astype(complex)) / sample_time
    slowest = np.min(np.abs(continuous), initial=nyquist, where=np.abs(continuous) > 1e-9 * nyquist)
    grid = [np.geomspace(min(1e-2 * slowest, 1e-3 * nyquist), nyquist, points)]
    resonant = continuous[np.abs(continuous.real) < 0.3 * np.abs(continuous.imag)]
    grid += [abs(p.imag) + max(abs(p.real), 1e-9 * abs(p.imag)) * np.linspace(-2.0, 2.0, 10) for p in resonant]
    omega = np.unique(np.concatenate(grid))
    return omega[(omega > 0) & (omega <= nyquist)]


def refined_peak(curve: LoopGain, omega: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Maximum of a real curve and its frequency [rad/s], refined between the points omega (n,) with `values` (n,).

    It refines every local maximum within 10 % of the largest, in five steps that each shrink the interval by eight.
    """
    best = float(np.max(values)), float(omega[int(np.argmax(values))])
    before, after = np.r_[-inf, values[:-1]], np.r_[values[1:], -inf]
    tops = (values >= before) & (values >= after) & (values >= 0.9 * best[0])
    for k in map(int, np.flatnonzero(tops)):
        low, high = omega[max(k - 1, 0)], omega[min(k + 1, omega.size - 1)]
        for _ in range(5):
            inner = np.linspace(low, high, 17)
            found = curve(inner)
            at = int(np.argmax(found))
            if found[at] > best[0]:
                best = float(found[at]), float(inner[at])
            low, high = inner[max(at - 1, 0)], inner[min(at + 1, 16)]
    return best


def _zero_crossings(function: Callable[[float], float], omega: np.ndarray, values: np.ndarray) -> list[float]:
    """Frequencies [rad/s] at which a curve with `values` (n,) at omega (n,) changes sign."""
    from scipy.optimize import brentq

    found = [float(w) for w in omega[values == 0.0]]
    for k in np.flatnonzero(values[1:] * values[:-1] < 0.0):
        found.append(float(brentq(function, omega[k], omega[k + 1], xtol=1e-12, rtol=1e-12)))
    return sorted(found)


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Margins of a loop. An unstable one has Ms and Mt, a disk margin of 0, and nan for all others.

    Attributes
    ----------
    crossover: frequency [rad/s] of the gain crossover with the smallest phase margin; nan without any.
    phase_margin: deg, smallest over all crossovers, lag or lead; inf without a crossover.
    gain_margin: smallest factor above 1 on the gain that destabilises the loop; gain_reduction: largest below 1.
    gain_frequency: rad/s, phase crossover of the gain margin; nan without any.
    delay_margin: s, additional delay that destabilises the loop, from the phase margins; inf without a crossover.
    Ms, Mt: peaks of |S| and |T|. disk_margin: alpha. disk_frequency: rad/s, where |S - 1/2| peaks.
    """

    crossover: float = nan
    phase_margin: float = nan
    gain_margin: float = nan
    gain_reduction: float = nan
    delay_margin: float = nan
    Ms: float
    Mt: float
    disk_margin: float = 0.0
    disk_frequency: float = nan
    gain_frequency: float = nan


def margins(
    gain: LoopGain, omega: np.ndarray, response: np.ndarray, *, static: float = inf, stable: bool = True
) -> Margins:
    """Margins of a loop from its gain on a grid, refined between the points.

    Parameters
    ----------
    gain: L at frequencies [rad/s], (n,) -> (n,) complex.
    omega: (n,) rad/s from `frequency_grid`, up to the Nyquist frequency. response: (n,) the gain there.
    static: gain at zero frequency, inf with an integrator.
    stable: whether the closed loop is stable, which does not follow from the frequency response.
    """

    def at(w: float) -> complex:
        return complex(gain(np.array([w]))[0])

    Ms, _ = refined_peak(lambda w: np.abs(1 / (1 + gain(w))), omega, np.abs(1 / (1 + response)))
    Mt, _ = refined_peak(lambda w: np.abs(1 - 1 / (1 + gain(w))), omega, np.abs(response / (1 + response)))
    if not stable:
        return Margins(Ms=Ms, Mt=Mt)
    disk, disk_frequency = refined_peak(
        lambda w: np.abs(1 / (1 + gain(w)) - 0.5), omega, np.abs(1 / (1 + response) - 0.5)
    )
    phase, delay, crossover = inf, inf, nan
    for w in _zero_crossings(lambda w: float(np.log(abs(at(w)))), omega, np.log(np.abs(response))):
        here = np.angle(-at(w))
        if abs(here) < phase:
            phase, crossover = float(abs(here)), w
        delay = min(delay, float(here % (2 * np.pi)) / w)
    # At the last point, z = -1, the gain is real, so that its imaginary part has no sign change there.
    inner = slice(None, -1)
    real = _zero_crossings(lambda w: at(w).imag, omega[inner], response[inner].imag)
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
        Ms=Ms,
        Mt=Mt,
        disk_margin=1 / disk,
        disk_frequency=disk_frequency,
        gain_frequency=gain_frequency,
    )


def disk_range(alpha: float) -> tuple[float, float, float]:
    """What a disk margin alpha guarantees: smallest and largest factor on the gain alone, phase alone [deg].

    (2 - alpha) / (2 + alpha), its inverse, and 2 atan(alpha / 2) (Seiler, Packard, Gahinet 2020).
    """
    low = max((2 - alpha) / (2 + alpha), 0.0)
    return low, 1 / low if low > 0 else inf, float(np.degrees(2 * atan(min(alpha, 2.0) / 2)))
