"""Bring sampled signals to another rate, or several rates to one: anti-aliasing without delay or change of gain."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import firwin, kaiserord, upfirdn

from .errors import InputError
from .text import join_words

#: Band of the anti-aliasing filter, as shares of the lower of both Nyquist frequencies: flat up to the first, blocked
#: from the second on.
PASS, STOP = 0.8, 1.0
#: Attenuation of the stop band, and ripple of the pass band [dB]: 1e-3.
ATTENUATION = 60.0
#: The filter's output has at least this many samples per sample of the slower side, so that a cubic spline between them
#: is exact to 1e-4 within the pass band.
OVERSAMPLING = 6
#: Largest number of samples after resampling.
MAX_SAMPLES = 10_000_000
#: Times that differ by less than this share of a sample are equal. Loggers round stamps: to 1 us of 4 ms, for instance.
EQUAL = 1e-3
#: Rates that differ by less than this share are equal, if the times are.
SAME_RATE = 1e-3


class Sampled(NamedTuple):
    """A signal with its own times: time (N,) s, increasing; values (N,)."""

    time: np.ndarray
    values: np.ndarray

    @property
    def step(self) -> float:
        """Its usual sample time [s]."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class RateChange:
    """How the signals of a log were brought to one rate.

    rate: the new one [Hz]. before: signal -> its rate in the file [Hz]. delay: signal -> delay of its filter [s], which
    was taken out again. held: signals that were averaged over each new sample instead.
    """

    rate: float
    before: Mapping[str, float]
    delay: Mapping[str, float]
    held: tuple[str, ...]

    def __str__(self) -> str:
        by_rate: dict[str, list[str]] = {}
        for name, rate in self.before.items():
            by_rate.setdefault(f"{rate:.5g} Hz", []).append(name)
        rates = ", ".join(f"{join_words(names)} at {rate}" for rate, names in by_rate.items())
        words = [f"several rates ({rates}) brought to {self.rate:.5g} Hz"]
        if self.held:
            words.append(f"{join_words(self.held)} averaged over each sample")
        if self.delay:
            longest = max(self.delay.values())
            low = self.rate / 2
            words.append(
                f"{join_words(self.delay)} by a low-pass (flat to {PASS * low:.4g} Hz, {ATTENUATION:g} dB from "
                f"{STOP * low:.4g} Hz, or these shares of a lower rate's band) whose delay of up to "
                f"{1e3 * longest:.3g} ms is taken out"
            )
        return ", ".join(words)

    def to_dict(self) -> dict[str, Any]:
        """The figures, for a result's JSON."""
        return {
            "rate": self.rate, "rates_before": dict(self.before), "delay_removed": dict(self.delay),
            "averaged": list(self.held), "pass_band": PASS * self.rate / 2, "stop_band": STOP * self.rate / 2,
            "attenuation_db": ATTENUATION,
        }  # fmt: skip


class Merged(NamedTuple):
    """Signals at one rate: time (M,) s, channels name -> (M,), and how they were brought there."""

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    change: RateChange


def sample_count(duration: float, rate: float, shortest: int = 2) -> int:
    """Number of samples at `rate` [Hz] of a log of this duration [s].

    Raises InputError for a rate that is not positive, and for a number below `shortest` or above MAX_SAMPLES.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise InputError(f"resample to {rate:g} Hz: the rate must be a number greater than 0")
    count = int(np.floor(duration * rate * (1 + 1e-9))) + 1
    if not shortest <= count <= MAX_SAMPLES:
        raise InputError(f"resample to {rate:g} Hz: leaves {count} samples; expected {shortest} to {MAX_SAMPLES}")
    return count


def merge(signals: Mapping[str, Sampled], rate: float, held: Collection[str] = ()) -> Merged:
    """The signals on one time grid of `rate` [Hz], over the time that all of them cover.

    The samples of a signal that has this rate already are the grid, and stay as they are.

    held: signals that are constant between their samples, such as the command of a drive, see `resample_signal`.
    Jitter of the times is removed.

    Raises InputError for a rate that is not positive or leaves too few or too many samples.
    """
    first = max(float(signal.time[0]) for signal in signals.values())
    last = min(float(signal.time[-1]) for signal in signals.values())
    first = next(
        (begin for signal in signals.values() if (begin := _own_begin(signal, first, rate)) is not None), first
    )
    time = first + np.arange(sample_count(last - first, rate)) / rate
    channels = {name: resample_signal(signal, time, rate, held=name in held) for name, signal in signals.items()}
    rates = {name: 1.0 / signal.step for name, signal in signals.items()}
    changed = [name for name, signal in signals.items() if _own_samples(signal, time, rate) is None]
    delay = {name: filter_delay(signals[name].step, rate) for name in changed if name not in held}
    averaged = tuple(name for name in changed if name in held)
    return Merged(time, channels, RateChange(rate, rates, delay, averaged))


def resample_signal(signal: Sampled, new: np.ndarray, rate: float, *, held: bool = False) -> np.ndarray:
    """Values of a signal at the times `new` (M,), which are uniform at `rate` [Hz].

    A held signal is averaged over each new sample, which preserves its integral. Any other passes a linear-phase
    low-pass with the pass and stop band above, whose delay is taken out, and is interpolated. Uneven times are brought
    to a uniform grid before. Beyond its ends a signal is continued by point reflection.
    """
    own = _own_samples(signal, new, rate)
    if own is not None:
        return own
    return _averaged(signal, new) if held else _band_limited(signal, new, rate)


def _own_begin(signal: Sampled, first: float, rate: float) -> float | None:
    """The first sample from `first` on of a signal that is uniform at `rate`; None for any other signal."""
    index = int(np.searchsorted(signal.time, first - EQUAL / rate))
    begins = float(signal.time[min(index, signal.time.size - 1)])
    grid = begins + np.arange(signal.time.size - index) / rate
    return begins if grid.size > 1 and _own_samples(signal, grid, rate) is not None else None


def _own_samples(signal: Sampled, new: np.ndarray, rate: float) -> np.ndarray | None:
    """The values of a signal that has samples at all times `new` and this rate already; else None."""
    time, values = signal
    if abs(signal.step * rate - 1.0) > SAME_RATE:
        return None
    index = np.rint((new - time[0]) * rate).astype(int)
    if index[0] < 0 or index[-1] >= time.size or not np.allclose(time[index], new, rtol=0.0, atol=EQUAL / rate):
        return None
    return values[index]


def filter_delay(step: float, rate: float) -> float:
    """Delay [s] of the low-pass for a signal of this sample time [s]: half its length."""
    return _taps(step, rate)[1] * step / _up(step, rate)


def _up(step: float, rate: float) -> int:
    """Factor by which the filter raises the rate of its input."""
    return max(int(np.ceil(OVERSAMPLING * min(1.0, step * rate) - 1e-9)), 1)


def _taps(step: float, rate: float) -> tuple[np.ndarray, int]:
    """The low-pass at the raised rate, and half its length in samples."""
    up = _up(step, rate)
    nyquist = min(rate, 1.0 / step) / 2
    length, beta = kaiserord(ATTENUATION, (STOP - PASS) * nyquist * 2 * step / up)
    half = int(length) // 2 + 1
    taps = firwin(2 * half + 1, (PASS + STOP) / 2 * nyquist, window=("kaiser", beta), fs=up / step)
    # Between two input samples, each of the `up` outputs has its own part of the taps; each keeps a constant as it is.
    for phase in range(up):
        taps[phase::up] /= taps[phase::up].sum()
    return taps, half


def _band_limited(signal: Sampled, new: np.ndarray, rate: float) -> np.ndarray:
    time, values = signal
    step = signal.step
    even = time[0] + step * np.arange(int(np.floor((time[-1] - time[0]) / step * (1 + 1e-9))) + 1)
    if even.size != time.size or not np.allclose(time, even, rtol=0.0, atol=1e-3 * step):
        values = CubicSpline(time, values)(np.minimum(even, time[-1]))
    taps, half = _taps(step, rate)
    up = _up(step, rate)
    margin = half // up + 3
    padded = np.pad(values, margin, mode="reflect", reflect_type="odd")
    filtered = upfirdn(taps, padded, up)
    fine = time[0] + step * ((np.arange(filtered.size) - half) / up - margin)
    inside = slice(2 * half, filtered.size - 2 * half)
    return CubicSpline(fine[inside], filtered[inside])(new)


def _averaged(signal: Sampled, new: np.ndarray) -> np.ndarray:
    """Means of a zero-order-held signal over the new samples."""
    time, values = signal
    edges = np.append(time, time[-1] + signal.step)
    integral = np.concatenate([[0.0], np.cumsum(values * np.diff(edges))])
    ends = np.minimum(np.append(new, new[-1] + new[1] - new[0]), edges[-1])
    return np.diff(np.interp(ends, edges, integral)) / np.diff(ends)
