"""Input currents: the experiments of the paper, and usual identification signals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.errors import InputError, choices

#: Longest excitation [s] and largest number of samples. Engineering judgement: a working day, at 250 Hz.
LONGEST, MOST_SAMPLES = 8 * 3600.0, 7_200_000


def noise(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Band-limited white noise, as in section 5 of the paper: 0.2 to 15 Hz, clipped at `amplitude` (3 sd).

    Above that band the shaft no longer follows. The first half second is a ramp from zero.
    """
    dt = time[1] - time[0]
    frequency = np.fft.rfftfreq(time.size, dt)
    spectrum = rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size)
    spectrum[(frequency < 0.2) | (frequency > 15.0)] = 0.0
    signal = np.fft.irfft(spectrum, time.size)
    deviation = signal.std()
    if deviation > 0:
        signal *= amplitude / 3.0 / deviation
    return np.clip(signal, -amplitude, amplitude) * np.minimum((time - time[0]) / 0.5, 1.0)


def steps(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Positive and negative steps with pauses, as in Fig. 7: zero, +amplitude, zero, -amplitude, for 0.25 s each."""
    phase = ((time - time[0]) / 0.25).round(9).astype(int)
    return amplitude * np.choose(phase % 4, [0.0, 1.0, 0.0, -1.0])


def sine(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """2 Hz sine, as in Fig. 8."""
    return amplitude * np.sin(2 * np.pi * 2.0 * (time - time[0]))


def ramp(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Linear rise from 0 to `amplitude`, as in Fig. 4, which shows breakaway."""
    return amplitude * (time - time[0]) / (time[-1] - time[0])


def chirp(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Sine whose frequency grows exponentially from 0.2 to 20 Hz over the record."""
    t = time - time[0]
    span = t[-1]
    growth = np.log(20.0 / 0.2)
    return amplitude * np.sin(2 * np.pi * 0.2 * span / growth * np.expm1(growth * t / span))


def multisine(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Sum of sines at odd multiples of 0.25 Hz up to 20 Hz with random phases, period 4 s, peak `amplitude`.

    Even nonlinearities of the plant show at the even multiples, which are not excited.
    """
    t = time - time[0]
    frequency = 0.25 * np.arange(1, 81, 2)
    phase = rng.uniform(0, 2 * np.pi, frequency.size)
    signal = np.sum(np.sin(2 * np.pi * np.outer(t, frequency) + phase) / np.sqrt(1 + frequency), axis=1)
    return amplitude * signal / np.max(np.abs(signal))


def white(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """A random value within +-amplitude at each sample: white up to the Nyquist frequency, for subspace models."""
    return amplitude * rng.uniform(-1.0, 1.0, time.size)


EXCITATIONS: dict[str, Callable[[np.ndarray, float, np.random.Generator], np.ndarray]] = {
    function.__name__: function for function in (noise, steps, sine, ramp, chirp, multisine, white)
}


def excitation(
    name: str, *, amplitude: float = 1.5, duration: float = 10.0, sample_time: float = 0.004, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Time (N,) [s] and current (N,) [A] of a named excitation, from t = 0 to `duration`.

    Raises InputError for an unknown name, a duration that is too short or too long, and infinite values.
    """
    if name not in EXCITATIONS:
        raise InputError(f"excitation {name!r} is not known; {choices(name, EXCITATIONS)}")
    if not (np.isfinite(duration) and 2 * sample_time <= duration <= LONGEST):
        raise InputError(
            f"duration = {duration:g} s; expected at least two samples of {sample_time:g} s and at most {LONGEST:g} s"
        )
    if duration > MOST_SAMPLES * sample_time:
        raise InputError(
            f"duration = {duration:g} s is {duration / sample_time:.3g} samples of {sample_time:g} s; expected at most "
            f"{MOST_SAMPLES}, so choose a shorter duration or a plant with a longer [sampling] period"
        )
    if not np.isfinite(amplitude):
        raise InputError(f"amplitude = {amplitude:g} A; expected a finite number")
    time = sample_time * np.arange(int(round(duration / sample_time)) + 1)
    return time, EXCITATIONS[name](time, amplitude, np.random.default_rng([seed, 77]))
