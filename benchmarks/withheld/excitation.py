"""Currents and rod references that drive the bench, drawn by seed."""

from __future__ import annotations

import numpy as np
from plant import SAMPLE
from scipy.signal import butter, lfilter

SHAPES = ("noise", "steps", "sine", "multisine", "chirp")


def current(shape: str, n: int, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """(N,) A. `amplitude` is the peak of sine, steps and chirp, about the peak of noise and multisine."""
    t = np.arange(n) * SAMPLE
    if shape == "noise":
        b, a = butter(2, rng.uniform(2.0, 8.0), fs=1.0 / SAMPLE)
        y = lfilter(b, a, rng.standard_normal(n + 500))[500:]
        return amplitude * 0.45 * y / np.std(y)
    if shape == "steps":
        lengths = rng.uniform(0.2, 0.8, n)
        index = np.searchsorted(np.cumsum(lengths), t, side="right")
        levels = rng.uniform(0.6, 1.0, n) * np.where(np.arange(n) % 2, -1.0, 1.0)
        levels[rng.random(n) < 0.15] = 0.0
        return amplitude * levels[index]
    if shape == "sine":
        return amplitude * np.sin(2.0 * np.pi * rng.uniform(1.0, 2.5) * t)
    if shape == "multisine":
        f = np.arange(1, 13) * rng.uniform(0.35, 0.6)
        y = np.sin(2.0 * np.pi * f[:, None] * t + rng.uniform(0.0, 2.0 * np.pi, f.size)[:, None]).sum(0)
        return amplitude * y / np.abs(y).max() * 1.2
    if shape == "chirp":
        low, high = rng.uniform(0.5, 1.0), rng.uniform(4.0, 8.0)
        duration = n * SAMPLE
        phase = low * t + 0.5 * (high - low) * t * t / duration
        return amplitude * np.sin(2.0 * np.pi * phase)
    raise ValueError(f"excitation {shape!r} is none of {', '.join(SHAPES)}")


def mixed(n: int, rng: np.random.Generator, parts: int = 3) -> np.ndarray:
    """Several shapes one after the other, each with an amplitude of its own."""
    chosen = rng.choice(SHAPES, parts, replace=False)
    edges = np.linspace(0, n, parts + 1).astype(int)
    pieces = [
        current(str(s), b - a, rng.uniform(1.7, 2.5), rng)
        for s, a, b in zip(chosen, edges[:-1], edges[1:], strict=True)
    ]
    return np.concatenate(pieces)


def weak(n: int, rng: np.random.Generator) -> tuple[str, np.ndarray]:
    """One thin input: a slow sine just above breakaway, one level both ways, or a few small bursts."""
    t = np.arange(n) * SAMPLE
    kind = str(rng.choice(["slow sine", "one level", "bursts"]))
    if kind == "slow sine":
        return kind, rng.uniform(1.2, 1.5) * np.sin(2.0 * np.pi * rng.uniform(0.25, 0.5) * t)
    if kind == "one level":
        return kind, rng.uniform(1.3, 1.7) * np.sign(np.sin(2.0 * np.pi * rng.uniform(0.3, 0.6) * t + 1e-9))
    gate = (t % 6.0) < 0.8
    return kind, gate * rng.uniform(1.4, 1.8) * np.sin(2.0 * np.pi * 1.25 * (t % 6.0)) * np.where(t % 12.0 < 6.0, 1, -1)


def reference(n: int, rng: np.random.Generator) -> np.ndarray:
    """(N,) m of rod position: smooth moves between random places, then a sine, within 25 mm of the middle."""
    t = np.arange(n) * SAMPLE
    lengths = rng.uniform(0.25, 0.8, n)
    index = np.searchsorted(np.cumsum(lengths), t, side="right")
    places = np.concatenate([[0.0], rng.uniform(-0.025, 0.025, n)])
    b, a = butter(2, rng.uniform(2.0, 5.0), fs=1.0 / SAMPLE)
    moves = lfilter(b, a, places[index])
    wave = rng.uniform(0.008, 0.015) * np.sin(2.0 * np.pi * rng.uniform(0.8, 1.8) * t)
    return np.where(t < 0.67 * t[-1], moves, wave)
