"""From the plant to the logger: the sensors' own effects, white noise, converter steps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from plant import DENSE, SAMPLE, Run
from scipy.signal import lfilter

CHANNELS = ("speed", "p1", "p2", "position", "force")
#: Bench noise, one standard deviation, SI; the position is then stored in steps of 10 um.
NOISE = {"current": 5e-3, "speed": 0.5, "p1": 15e3, "p2": 15e3, "position": 20e-6, "force": 15.0}
POSITION_STEP = 10e-6
#: Families logged by a rig's own logger, and its encoder's step [m].
LOGGER_FAMILIES = ("rig_loop", "production", "outside_rig")
LOGGER_STEP = 1e-6
#: Decimals in the CSV.
DECIMALS = {"t": 3, "current": 4, "speed": 3, "p1": 0, "p2": 0, "position": 6, "force": 1}


@dataclass(frozen=True)
class Sensors:
    """Each mapping goes from channel to size; a missing channel has none."""

    noise: dict[str, float] = field(default_factory=lambda: dict(NOISE))
    bias: dict[str, float] = field(default_factory=dict)
    scale: dict[str, float] = field(default_factory=dict)
    delay: dict[str, float] = field(default_factory=dict)
    lag: dict[str, float] = field(default_factory=dict)
    step: dict[str, float] = field(default_factory=lambda: {"position": POSITION_STEP})
    drift: float = 0.0  # Pa, slow and different in either pressure
    #: Outside the catalogue: amplitudes.
    mains: float = 0.0  # Pa, 50 Hz on both pressures
    spikes: float = 0.0  # Pa, rare and alike in both pressures
    bow: float = 0.0  # m, the potentiometer's linearity error, two waves over the stroke used
    dropouts: float = 0.0  # share of the time in which the speed holds its last value

    @staticmethod
    def of_a_logger(rng: np.random.Generator) -> Sensors:
        """Less noise, but converters of 12 to 16 bits, an incremental encoder and a slow drift of the pressures."""
        p_sd, p_step = rng.uniform(5e3, 15e3), 100e5 / 2.0 ** rng.integers(11, 15)
        noise = {
            "current": rng.uniform(1e-3, 3e-3), "speed": rng.uniform(0.25, 0.6), "p1": p_sd, "p2": p_sd,
            "position": 0.5e-6, "force": NOISE["force"],
        }  # fmt: skip
        step = {
            "current": 6.7 / 2.0 ** rng.integers(11, 14), "speed": float(rng.choice([0.1, 0.2, 0.4])), "p1": p_step,
            "p2": p_step, "position": LOGGER_STEP,
        }  # fmt: skip
        return Sensors(noise=noise, step=step, drift=rng.uniform(0.0, 3e3))

    def clean(self, run: Run, rng: np.random.Generator) -> np.ndarray:
        """(N, 5) channels without noise."""
        out = run.samples.copy()
        fine = np.arange(run.dense.shape[0]) * SAMPLE / DENSE
        t = fine[:-1:DENSE]
        for column, name in enumerate(CHANNELS):
            y = run.dense[:, column]
            if name in self.lag:
                y = _lagged(y, self.lag[name], SAMPLE / DENSE)
            if name in self.delay or name in self.lag:
                out[:, column] = np.interp(t - self.delay.get(name, 0.0), fine, y)
            out[:, column] = out[:, column] * self.scale.get(name, 1.0) + self.bias.get(name, 0.0)
        if self.drift:
            out[:, 1] += self.drift * np.sin(0.2 * t)
            out[:, 2] += self.drift * np.sin(0.13 * t + 1.0)
        if self.mains:
            out[:, 1:3] += self.mains * np.sin(2.0 * np.pi * 49.97 * t + 0.4)[:, None]
        if self.spikes:
            hit = rng.random(t.size) < 0.01
            out[:, 1:3] += (hit * self.spikes * rng.standard_normal(t.size) * 5.0)[:, None]
        if self.bow:
            reach = max(np.ptp(out[:, 3]), 1e-4)
            out[:, 3] += self.bow * np.sin(4.0 * np.pi * out[:, 3] / reach)
        if self.dropouts:
            start = rng.random(t.size) < self.dropouts / 20.0
            frozen = np.convolve(start, np.ones(20))[: t.size] > 0
            held = np.maximum.accumulate(np.where(frozen, 0, np.arange(t.size)))
            out[:, 0] = out[held, 0]
        return out

    def log(self, run: Run, rng: np.random.Generator, *, force: bool) -> dict[str, np.ndarray]:
        """Columns of the CSV, rounded as they are written."""
        clean = self.clean(run, rng)
        n = run.current.size
        current = run.current * self.scale.get("current", 1.0) + self.bias.get("current", 0.0)
        noisy = current + self.noise["current"] * rng.standard_normal(n)
        columns = {"t": np.arange(n) * SAMPLE, "current": self._stored("current", noisy)}
        for column, name in enumerate(CHANNELS):
            y = clean[:, column] + self.noise[name] * rng.standard_normal(n)
            if name != "force" or force:
                columns[name] = self._stored(name, y)
        return {name: np.round(y, DECIMALS[name]) for name, y in columns.items()}

    def _stored(self, name: str, y: np.ndarray) -> np.ndarray:
        """In whole steps of the converter, if it has any."""
        step = self.step.get(name, 0.0)
        return np.round(y / step) * step if step else y


def _lagged(y: np.ndarray, tau: float, step: float) -> np.ndarray:
    """First-order filter of a signal that runs straight between its points."""
    a = float(np.exp(-step / tau))
    slope = (1.0 - a) * tau / step
    new, old = 1.0 - slope, slope - a
    return lfilter([new, old], [1.0, -a], y, zi=[(1.0 - new) * y[0]])[0]
