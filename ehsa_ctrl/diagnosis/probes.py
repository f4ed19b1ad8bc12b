"""Inputs that may tell candidates apart: excitations of the bench, slow and one-sided ones, bands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..identification.shapes import Part, Shape

#: Low, middle and high band of multisines [Hz].
BANDS = ((0.125, 1.0), (1.0, 5.0), (5.0, 20.0))


@dataclass(frozen=True)
class Probe:
    """An input: words that an amplitude follows, and current (N,) [A] of time (N,) [s] from zero and amplitude [A].

    share: of the largest amplitude that the limits allow; friction shows better where the plant hardly moves.
    excitation: its name on the command line, if it has one.
    """

    words: str
    current: Callable[[np.ndarray, float], np.ndarray]
    share: float = 1.0
    excitation: str | None = None


def probes(seed: int = 0) -> tuple[Probe, ...]:
    """The library; seed: of the random ones."""

    def of(part: Part) -> Callable[[np.ndarray, float], np.ndarray]:
        return Shape((part,)).current

    noise = ("band-limited noise (0.2-15 Hz) with peaks of", of(Part("noise", seed=seed)))
    steps = ("steps to both sides of", of(Part("steps")))
    slow = ("slow ramps through zero at 0.1 Hz of", _ramps(0.1))
    return (
        Probe(*noise, excitation="noise"),
        Probe(*noise, share=0.4, excitation="noise"),
        *(Probe(f"a multisine of {low:g}-{high:g} Hz with peaks of", _band(low, high, seed)) for low, high in BANDS),
        Probe(*steps, excitation="steps"),
        Probe(*steps, share=0.4, excitation="steps"),
        Probe(*slow),
        Probe(*slow, share=0.4),
        Probe("ramps through zero at 0.4 Hz of", _ramps(0.4)),
        Probe("a sine at 2 Hz of", of(Part("sine")), excitation="sine"),
        Probe("a sine at 0.5 Hz of", of(Part("sine", pace=0.25))),
        Probe("a chirp (0.2-20 Hz) of", of(Part("chirp")), excitation="chirp"),
        Probe("steps that only extend of", _pulses(1.0)),
        Probe("steps that only retract of", _pulses(-1.0)),
    )


def _band(low: float, high: float, seed: int) -> Callable[[np.ndarray, float], np.ndarray]:
    """Sines of equal size at multiples of 1/8 Hz in a band, random phases; from zero within half a second."""

    def current(time: np.ndarray, amplitude: float) -> np.ndarray:
        frequency = np.arange(low, high + 1e-9, 0.125)
        phase = np.random.default_rng([seed, 79]).uniform(0.0, 2.0 * np.pi, frequency.size)
        signal = np.sum(np.sin(2.0 * np.pi * np.outer(time, frequency) + phase), axis=1)
        return np.asarray(amplitude * signal / np.max(np.abs(signal)) * np.minimum(time / 0.5, 1.0))

    return current


def _ramps(frequency: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """A triangle from zero: up, down through zero, up again."""

    def current(time: np.ndarray, amplitude: float) -> np.ndarray:
        return np.asarray(amplitude * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * frequency * time)))

    return current


def _pulses(sign: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """Half a second on, one and a half off; from 0.25 s."""

    def current(time: np.ndarray, amplitude: float) -> np.ndarray:
        phase = ((time - 0.25) / 0.25).round(9).astype(int) % 8
        return sign * amplitude * ((phase < 2) & (time >= 0.25 - 1e-9))

    return current
