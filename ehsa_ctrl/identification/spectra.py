"""Frequency response of one input and one output: from averaged spectra, or from the periods of a multisine.

J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., 2010 (H1, H2, coherence and their errors).
R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., 2012 (best linear
approximation and its variances by noise and by nonlinearity, the robust method of section 4.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: A line counts as excited from this share of the largest one on: multisines are flat within 20 dB.
EXCITED = 0.05
#: Spectral densities below this share of the largest input density hold leakage and noise (30 dB).
INPUT_FLOOR = 1e-3
#: Standard deviation by noise, relative to the response, up to which a frequency is compared with models and drawn.
#: Engineering judgement: 2 dB.
RELIABLE = 0.25
#: Correlation of a signal with itself a period later from which it counts as periodic; a slow centring loop lowers it.
PERIODIC = 0.9
#: Segments that are averaged by default, at half overlap: a compromise of resolution and variance.
SEGMENTS = 15
#: Correlation of neighbouring Hann segments at half overlap (P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 1967).
OVERLAP_CORRELATION = 1.0 / 6.0


@dataclass(frozen=True)
class ResponseLines:
    """Frequency response at some frequencies.

    Attributes
    ----------
    frequency: (n,) Hz. response: (n,) complex.
    noise_sd: (n,) standard deviation of the complex response by noise, in its unit.
    nonlinear_sd: (n,) by nonlinearity; nan where it can't be told from noise.
    coherence: (n,) 0 to 1; nan for a periodic record.
    even, odd: size of the output at even and odd lines without excitation, relative to that at excited lines; nan where
        there are none.
    """

    frequency: np.ndarray
    response: np.ndarray
    noise_sd: np.ndarray
    nonlinear_sd: np.ndarray
    coherence: np.ndarray
    even: float = float("nan")
    odd: float = float("nan")

    def __len__(self) -> int:
        return self.frequency.size

    @property
    def reliable(self) -> np.ndarray:
        """(n,) bool: frequencies at which the noise is at most RELIABLE of the response."""
        return self.noise_sd <= RELIABLE * np.abs(self.response)

    @property
    def sd(self) -> np.ndarray:
        """(n,) standard deviation by noise and nonlinearity together."""
        return np.sqrt(self.noise_sd**2 + np.nan_to_num(self.nonlinear_sd) ** 2)


def spectral_response(
    inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], sample_time: float, segment: int, estimator: str
) -> ResponseLines:
    """H1 or H2 and the coherence by Welch's method (scipy.signal), Hann windows at half overlap.

    inputs, outputs: (N_i,) of each record. segment: samples. H1 is unbiased for noise at the output, H2 for
    noise at the input. noise_sd is the random error of H1 for this coherence.
    """
    from scipy.signal import csd

    options = {"fs": 1.0 / sample_time, "nperseg": segment, "detrend": "linear"}
    weights = np.array([max(2 * (u.size // segment) - 1, 1) for u in inputs], dtype=float)
    share = weights / weights.sum()
    pairs = list(zip(inputs, outputs, share, strict=True))
    frequency, _ = csd(inputs[0], inputs[0], **options)
    uu = sum(w * csd(u, u, **options)[1].real for u, _, w in pairs)
    yy = sum(w * csd(y, y, **options)[1].real for _, y, w in pairs)
    uy = sum(w * csd(u, y, **options)[1] for u, y, w in pairs)
    there = (frequency > 0) & (uu >= INPUT_FLOOR * np.max(uu)) & (yy > 0)
    frequency, uu, yy, uy = frequency[there], uu[there], yy[there], uy[there]
    coherence = np.clip(np.abs(uy) ** 2 / (uu * yy), 1e-12, 1.0)
    response = uy / uu if estimator == "H1" else yy / np.conj(uy)
    averages = weights.sum() / (1.0 + 2.0 * OVERLAP_CORRELATION**2)
    error = np.abs(response) * np.sqrt((1.0 - coherence) / (2.0 * coherence * averages))
    # sd of a complex number: of its real and imaginary part together.
    return ResponseLines(frequency, response, np.sqrt(2.0) * error, np.full(error.size, np.nan), coherence)


def find_period(signal: np.ndarray) -> int | None:
    """Period of a signal [samples], at most half its length; None for one that does not repeat."""
    n = signal.size
    centred = signal - signal.mean()
    spectrum = np.fft.rfft(centred, 2 * n)
    product = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n)[: n // 2 + 1]
    energy = np.concatenate([[0.0], np.cumsum(centred**2)])
    lags = np.arange(product.size)
    both = np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    correlation = np.divide(product, both, out=np.zeros_like(product), where=both > 0)
    low = np.flatnonzero(correlation < 0.5)
    if low.size == 0:
        return None
    rest = correlation[low[0] :]
    best = float(np.max(rest))
    if best < PERIODIC:
        return None
    inner = np.r_[False, (rest[1:-1] >= rest[:-2]) & (rest[1:-1] >= rest[2:]), rest[-1] > rest[-2]]
    peaks = np.flatnonzero(inner & (rest >= best - 0.03))
    return int(low[0] + peaks[0]) if peaks.size else None


def periodic_response(
    inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], sample_time: float, period: int, settle: int
) -> ResponseLines:
    """Best linear approximation at the excited lines of a periodic input.

    Each record is a realisation, with phases of its own. The scatter between its periods is noise; that between
    realisations beyond the noise is nonlinearity, which needs two records or more. The drift of an
    integrating output is removed first.

    period, settle: samples of a period, and before the first period that is used. Every record has at least
    settle + 2 period samples.
    """
    spectra = [
        (_periods(u, period, settle, slope=False), _periods(y, period, settle, slope=True))
        for u, y in zip(inputs, outputs, strict=True)
    ]
    size = np.sqrt(np.mean([np.abs(u.mean(axis=0)) ** 2 for u, _ in spectra], axis=0))
    size[0] = 0.0
    excited = np.flatnonzero(size >= EXCITED * np.max(size))
    responses, noise = [], []
    for u, y in spectra:
        mean_u, mean_y, count = u.mean(axis=0), y.mean(axis=0), len(u)
        response = mean_y[excited] / mean_u[excited]
        rest = (y[:, excited] - mean_y[excited]) - response * (u[:, excited] - mean_u[excited])
        scatter = np.sum(np.abs(rest) ** 2, axis=0) / max(count - 1, 1) / count
        responses.append(response)
        noise.append(scatter / np.abs(mean_u[excited]) ** 2)
    count = len(spectra)
    found = np.mean(responses, axis=0)
    noise_variance = np.sum(noise, axis=0) / count**2
    nonlinear = np.full(found.size, np.nan)
    if count > 1:
        total = np.sum(np.abs(np.array(responses) - found) ** 2, axis=0) / (count * (count - 1))
        nonlinear = np.sqrt(np.maximum(total - noise_variance, 0.0))
    frequency = excited / (period * sample_time)
    even, odd = (_unexcited(spectra, excited, found, parity) for parity in (0, 1))
    return ResponseLines(frequency, found, np.sqrt(noise_variance), nonlinear, np.full(found.size, np.nan), even, odd)


def _periods(signal: np.ndarray, period: int, settle: int, *, slope: bool) -> np.ndarray:
    """Spectra (periods, lines) of the whole periods after `settle`; with `slope` without the drift of their means."""
    count = (signal.size - settle) // period
    parts = signal[settle : settle + count * period].reshape(count, period).astype(float)
    if slope:
        # Means of whole periods contain nothing of the periodic part, and little noise.
        rise = np.polyfit(np.arange(count), parts.mean(axis=1), 1)[0]
        parts = parts - rise * np.arange(period) / period
    return np.asarray(np.fft.rfft(parts, axis=1) / period)


def _unexcited(
    spectra: Sequence[tuple[np.ndarray, np.ndarray]], excited: np.ndarray, response: np.ndarray, parity: int
) -> float:
    """Size of the output at unexcited even (0) or odd (1) lines within the band, relative to that at excited ones.

    What the input has there, by a feedback loop, is removed with the interpolated response.
    """
    band = np.arange(excited[0], excited[-1] + 1)
    lines = np.setdiff1d(band[band % 2 == parity], excited)
    if lines.size == 0 or (parity == 1 and not np.any(excited % 2 == 1)) or np.all(np.diff(excited) == 1):
        return float("nan")
    there = np.interp(lines, excited, response.real) + 1j * np.interp(lines, excited, response.imag)
    rest = [np.abs(y.mean(axis=0)[lines] - there * u.mean(axis=0)[lines]) for u, y in spectra]
    main = [np.abs(y.mean(axis=0)[excited]) for _, y in spectra]
    return float(np.sqrt(np.mean(np.square(rest)) / np.mean(np.square(main))))
