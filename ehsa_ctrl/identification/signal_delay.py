"""Delay between two signals that are alike: cross-correlation for whole samples, then the slope of the phase.

Sources: C. H. Knapp, G. C. Carter, "The generalized correlation method for estimation of time delay", IEEE Trans.
ASSP 24 (1976), for the weight of each frequency by coherence; B. Efron, "The jackknife, the bootstrap and other
resampling plans", SIAM 1982, for the standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import correlate, correlation_lags

# The constants are engineering judgement unless a figure is given.

#: Longest delay that is looked for [s], and the largest share of the signals' length.
LONGEST_DELAY, LONGEST_SHARE = 1.0, 0.25
#: Fewest samples of a signal: four segments of a spectrum with some ten frequencies each.
FEWEST_SAMPLES = 100
#: Times [s] over which changes of the signals are correlated: the shortest suits signals with little noise. A longer
#: one is taken where it correlates better by CLEARLY.
CHANGE_TIMES, CLEARLY = (0.0, 0.02, 0.06, 0.2), 0.02
#: Time [s] over which changes are compared, as for the rod's velocity of a diagnosis.
GAP_TIME = 0.02
#: Length of the segments of the spectra [s], and the fewest samples of one.
SEGMENT, FEWEST_IN_SEGMENT = 2.0, 64
#: Errors of a model limit the weight of a frequency: as noise of this share of the power.
MODEL_ERROR = 0.03
#: Power that a window leaks to other frequencies, as a share of the largest; without noise it would be coherent.
LEAKAGE = 1e-6
#: Coherence below which a frequency has no weight, and the share of the Nyquist frequency that is used.
LEAST_COHERENCE, HIGHEST = 0.05, 0.8
#: Smallest correlation of the changes that shows a delay.
MIN_CORRELATION = 0.6
#: Two peaks of the correlation within this share of each other can't be told apart: the signals are periodic.
EQUAL_PEAKS = 0.03
#: Number of segments, by the participation ratio of their power, from which a delay is that of the whole log: a ramp
#: that overcomes friction once has at most 3.2, and wrong friction moves that one time; noise, steps and sines have 6.
FEWEST_EVENTS = 3.5
#: Parts that the jackknife leaves out in turn.
PARTS = 10


@dataclass(frozen=True)
class SignalDelay:
    """Delay of a signal against another one.

    Attributes
    ----------
    value, sd: delay [s], positive if the signal is late, and its standard deviation.
    correlation: of the changes of both signals at this delay.
    gap: what is left of the difference of the signals' changes after the shift, as a share of the difference before:
        0 if the signal is only late, 1 if a shift explains nothing.
    phase_gap: the same for the phases, where sizes play no part.
    period: the delay may as well be larger or smaller by this time [s]; None if it is unique.
    why: why there is no delay to speak of, in words; empty if there is one.
    """

    value: float = 0.0
    sd: float = float("inf")
    correlation: float = 0.0
    gap: float = 1.0
    phase_gap: float = 1.0
    period: float | None = None
    why: str = ""


def estimate_delay(measured: np.ndarray, reference: np.ndarray, sample_time: float) -> SignalDelay:
    """Delay of `measured` (N,) against `reference` (N,), up to LONGEST_DELAY, in fractions of a sample.

    Delay and correlation allow for a constant factor and a drift, the gap for the drift alone. `why` has the reason for
    signals that are too short or constant, or do not correlate.
    """
    if measured.size < FEWEST_SAMPLES:
        return SignalDelay(why=f"{measured.size} samples are too few, {FEWEST_SAMPLES} are needed")
    if np.ptp(measured) == 0.0 or np.ptp(reference) == 0.0:
        return SignalDelay(why="it is constant" if np.ptp(measured) == 0.0 else "the simulated one is constant")
    peak = _correlate_changes(measured, reference, sample_time)
    if peak.why or peak.correlation < MIN_CORRELATION:
        low = f"changes correlate by only {peak.correlation:.2f}, {MIN_CORRELATION:g} is needed"
        return SignalDelay(peak.lag * sample_time, correlation=peak.correlation, why=peak.why or low)
    fine = _Phases.of(measured, reference, sample_time, peak)
    value, error = fine.delay(np.arange(len(fine.cross)))
    whole = value + peak.lag * sample_time
    if abs(value) >= fine.limit * (1.0 - 1e-6):
        return SignalDelay(
            peak.lag * sample_time, correlation=peak.correlation, why="the peak of the correlation is too broad"
        )
    if fine.events() < FEWEST_EVENTS:
        return SignalDelay(
            whole, correlation=peak.correlation, why="it moves at too few times to tell a delay from other causes"
        )
    parts = np.array_split(np.arange(len(fine.cross)), min(PARTS, len(fine.cross)))
    left_out = np.array([fine.delay(np.setdiff1d(np.arange(len(fine.cross)), part))[0] for part in parts])
    sd = float(np.sqrt((len(parts) - 1) / len(parts) * np.sum((left_out - np.mean(left_out)) ** 2)))
    before = fine.error(np.arange(len(fine.cross)), -peak.lag * sample_time)
    return SignalDelay(
        whole,
        float(np.hypot(sd, fine.model_sd(error))),
        peak.correlation,
        _gap(measured, reference, whole, sample_time, peak.change),
        float(np.sqrt(error / before)) if before > 0.0 else 1.0,
        peak.period,
    )


@dataclass(frozen=True)
class _Peak:
    """The peak of the correlation: its lag and the change it was found with [samples], its height, its period [s]."""

    lag: int = 0
    change: int = 1
    correlation: float = 0.0
    period: float | None = None
    why: str = ""


def _correlate_changes(measured: np.ndarray, reference: np.ndarray, dt: float) -> _Peak:
    """The peak nearest to zero among those that are equal, by the shortest change that correlates well."""
    best = _Peak()
    for time in CHANGE_TIMES:
        change = max(int(round(time / dt)), 1)
        if 4 * change > measured.size:
            break
        a, b = _changes(measured, change), _changes(reference, change)
        size = float(np.linalg.norm(a) * np.linalg.norm(b))
        if size == 0.0:
            continue
        lags = correlation_lags(a.size, b.size)
        near = np.abs(lags) <= min(int(np.ceil(LONGEST_DELAY / dt)), int(LONGEST_SHARE * a.size))
        product, lags = correlate(a, b, method="fft")[near] / size, lags[near]
        if np.max(product) < best.correlation + (CLEARLY if best.correlation else 0.0):
            continue
        peaks = np.flatnonzero((product[1:-1] >= product[:-2]) & (product[1:-1] >= product[2:])) + 1
        # Peaks of a periodic signal fall with the overlap.
        height = product[peaks] / (1.0 - np.abs(lags[peaks]) / a.size)
        equal = peaks[height > (1.0 - EQUAL_PEAKS) * np.max(height)] if peaks.size else peaks
        if not equal.size:
            best = _Peak(
                int(lags[np.argmax(product)]), change, float(np.max(product)), why="it is at the longest delay"
            )
            continue
        at = int(equal[np.argmin(np.abs(lags[equal]))])
        why = "it moves the other way" if product[lags == 0][0] < -0.8 * product[at] else ""
        best = _Peak(int(lags[at]), change, float(product[at]), _period(product, lags, equal, dt), why)
    return best


def _period(product: np.ndarray, lags: np.ndarray, equal: np.ndarray, dt: float) -> float | None:
    """Distance [s] of equal peaks with a valley between them; noise on one peak makes several without a valley."""
    distances = [
        (lags[second] - lags[first]) * dt
        for first, second in zip(equal[:-1], equal[1:], strict=True)
        if np.min(product[first:second]) < 0.5 * product[first]
    ]
    return float(np.median(distances)) if distances else None


def _changes(values: np.ndarray, change: int) -> np.ndarray:
    found = values[change:] - values[:-change]
    return np.asarray(found - np.mean(found))


@dataclass(frozen=True)
class _Phases:
    """Cross spectra of aligned segments; limit: largest delay left after the alignment [s]."""

    cross: np.ndarray
    own: np.ndarray
    other: np.ndarray
    frequency: np.ndarray
    limit: float

    @classmethod
    def of(cls, measured: np.ndarray, reference: np.ndarray, dt: float, peak: _Peak) -> _Phases:
        lag, count = peak.lag, measured.size - abs(peak.lag)
        a, b = np.diff(measured[max(lag, 0) :][:count]), np.diff(reference[max(-lag, 0) :][:count])
        width = min(max(int(SEGMENT / dt), FEWEST_IN_SEGMENT), a.size // 4)
        window, starts = np.hanning(width), range(0, a.size - width + 1, width // 2)
        frequency = 2.0 * np.pi * np.fft.rfftfreq(width, dt)
        used = (frequency > 0.0) & (frequency < HIGHEST * np.pi / dt)

        def spectra(values: np.ndarray) -> np.ndarray:
            pieces = np.array([values[k : k + width] for k in starts])
            return np.fft.rfft(window * (pieces - pieces.mean(axis=1, keepdims=True)), axis=1)[:, used]

        A, B = spectra(a), spectra(b)
        limit = max(3.0, 0.5 * peak.change) * dt
        return cls(A * B.conj(), np.abs(A) ** 2, np.abs(B) ** 2, frequency[used], limit)

    def _weights(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Phase and weight (sum 1) of each frequency, from these segments."""
        cross, own, other = (spectrum[rows].sum(axis=0) for spectrum in (self.cross, self.own, self.other))
        power = (own + LEAKAGE * np.max(own)) * (other + LEAKAGE * np.max(other))
        coherence = np.divide(np.abs(cross) ** 2, power, out=np.zeros_like(power), where=power > 0.0)
        # Chance makes the coherence of k independent segments 1 / k; segments that overlap by half count for 0.7.
        chance = 1.0 / max(0.7 * rows.size, 2.0)
        coherence = np.clip((coherence - chance) / (1.0 - chance), 0.0, 1.0)
        weight = np.where(coherence > LEAST_COHERENCE, coherence / (1.0 - coherence + MODEL_ERROR), 0.0)
        total = float(np.sum(weight))
        return np.angle(cross), weight / total if total > 0.0 else np.full(weight.size, 1.0 / weight.size)

    def events(self) -> float:
        """Number of segments in which both signals move, as the participation ratio of their common power."""
        power = np.sum(np.abs(self.cross), axis=1)
        return float(np.sum(power)) ** 2 / max(float(np.sum(power**2)), 1e-300)

    def error(self, rows: np.ndarray, delay: float) -> float:
        """Weighted mean of 1 - cos(phase error) if these segments are late by `delay` [s]."""
        phase, weight = self._weights(rows)
        return float(np.sum(weight * (1.0 - np.cos(phase + self.frequency * delay))))

    def delay(self, rows: np.ndarray) -> tuple[float, float]:
        """Delay [s] with the smallest error, and this error."""
        phase, weight = self._weights(rows)

        def errors(delays: np.ndarray) -> np.ndarray:
            return np.asarray((1.0 - np.cos(phase + delays[:, None] * self.frequency)) @ weight)

        return _minimum(errors, self.limit)

    def model_sd(self, error: float) -> float:
        """Standard deviation [s] of a phase slope with this error of the phases, independent from one to the next."""
        _, weight = self._weights(np.arange(len(self.cross)))
        slope = float(np.sqrt(np.sum(weight * self.frequency**2)))
        return float(np.sqrt(2.0 * max(error, 0.0) * np.sum(weight**2))) / slope


def _minimum(errors: Callable[[np.ndarray], np.ndarray], limit: float) -> tuple[float, float]:
    """The smallest of errors within +- limit, by a grid that is refined four times around its best point."""
    grid = np.linspace(-limit, limit, 61)
    found = errors(grid)
    for _ in range(4):
        at = int(np.argmin(found))
        grid = np.linspace(grid[max(at - 1, 0)], grid[min(at + 1, grid.size - 1)], 9)
        found = errors(grid)
    at = int(np.argmin(found))
    return float(grid[at]), float(found[at])


def _gap(measured: np.ndarray, reference: np.ndarray, delay: float, dt: float, change: int) -> float:
    """Difference of the changes after the shift over that before, white noise of the measurement subtracted.

    1 where there is hardly a difference beside noise, or the shift takes away less than 40 % of it, noise included.
    """
    index = np.arange(measured.size)
    shifted = CubicSpline(index, reference)(np.clip(index - delay / dt, 0, measured.size - 1))
    inside = slice(max(int(np.ceil(delay / dt)), 0), measured.size + min(int(np.floor(delay / dt)), 0))
    width = max(int(round(GAP_TIME / dt)), change)
    a = _changes(measured[inside], width)
    noise = 2.0 * (float(np.median(np.abs(np.diff(measured, 2)))) / 0.6745) ** 2 / 6.0
    before, after = (float(np.mean((a - _changes(each[inside], width)) ** 2)) for each in (reference, shifted))
    if after > 0.6 * before or before < 1.1 * noise:
        return 1.0
    return float(np.sqrt(max(after - noise, 0.0) / (before - noise))) if before > 0.0 else 1.0
