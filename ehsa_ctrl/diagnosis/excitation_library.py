"""Library of inputs for the next experiment: excitations of the bench, triangle waves, one-sided steps, multisines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..identification.input_shapes import InputPart, InputShape

#: Bands of the multisines [Hz]; engineering judgement.
BANDS = ((0.125, 1.0), (1.0, 5.0), (5.0, 20.0))

Current = Callable[[np.ndarray, float], np.ndarray]


@dataclass(frozen=True)
class LibraryInput:
    """An input of the library.

    words: text that ends before the amplitude. current: function of time (N,) [s] from zero and amplitude [A] that
    gives the current (N,) [A]. share: of the largest amplitude within the limits; small motion shows friction better.
    excitation: its name on the command line, if it has one.
    """

    words: str
    current: Current
    share: float = 1.0
    excitation: str | None = None


def library_inputs(seed: int = 0) -> tuple[LibraryInput, ...]:
    """The library. seed: of random inputs."""

    def shape(part: InputPart) -> Current:
        return InputShape((part,)).current

    noise = ("band-limited noise (0.2-15 Hz) with peaks of", shape(InputPart("noise", seed=seed)))
    steps = ("steps in both directions of", shape(InputPart("steps")))
    slow = ("a slow triangle wave (0.1 Hz) of", _triangle(0.1))
    bands = ((f"a multisine of {low:g}-{high:g} Hz with peaks of", _multisine(low, high, seed)) for low, high in BANDS)
    return (
        LibraryInput(*noise, excitation="noise"),
        LibraryInput(*noise, share=0.4, excitation="noise"),
        *(LibraryInput(*band) for band in bands),
        LibraryInput(*steps, excitation="steps"),
        LibraryInput(*steps, share=0.4, excitation="steps"),
        LibraryInput(*slow),
        LibraryInput(*slow, share=0.4),
        LibraryInput("a triangle wave (0.4 Hz) of", _triangle(0.4)),
        LibraryInput("a sine at 2 Hz of", shape(InputPart("sine")), excitation="sine"),
        LibraryInput("a sine at 0.5 Hz of", shape(InputPart("sine", pace=0.25))),
        LibraryInput("a chirp (0.2-20 Hz) of", shape(InputPart("chirp")), excitation="chirp"),
        LibraryInput("extending steps of", _pulses(1.0)),
        LibraryInput("retracting steps of", _pulses(-1.0)),
    )


def _multisine(low: float, high: float, seed: int) -> Current:
    """Sines of equal amplitude with random phases at multiples of 1/8 Hz in a band, faded in over 0.5 s."""

    def current(time: np.ndarray, amplitude: float) -> np.ndarray:
        frequency = np.arange(low, high + 1e-9, 0.125)
        phase = np.random.default_rng([seed, 79]).uniform(0.0, 2.0 * np.pi, frequency.size)
        signal = np.sum(np.sin(2.0 * np.pi * np.outer(time, frequency) + phase), axis=1)
        return np.asarray(amplitude * signal / np.max(np.abs(signal)) * np.minimum(time / 0.5, 1.0))

    return current


def _triangle(frequency: float) -> Current:
    """A triangular wave that starts at zero."""

    def current(time: np.ndarray, amplitude: float) -> np.ndarray:
        return np.asarray(amplitude * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * frequency * time)))

    return current


def _pulses(sign: float) -> Current:
    """Pulses of 0.5 s with pauses of 1.5 s, from 0.25 s on."""

    def current(time: np.ndarray, amplitude: float) -> np.ndarray:
        phase = ((time - 0.25) / 0.25).round(9).astype(int) % 8
        return sign * amplitude * ((phase < 2) & (time >= 0.25 - 1e-9))

    return current
