"""The squared gap by signal, as part of the believed plant's: the yardstick of every place."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .signals import SIGNALS, scored, signal_noise

Energy = np.ndarray


class SquaredGap:
    """Squared gap by signal of what was measured to simulations, noise taken off, as part of the believed plant's."""

    def __init__(self, measured: Mapping[str, np.ndarray], noise: Mapping[str, float], dt: float) -> None:
        self.dt, self.noise = dt, signal_noise(noise, dt)
        self.signals = scored(measured, dt)
        self.names = tuple(name for name in SIGNALS if name in self.signals)
        self.power = {name: max(float(np.var(self.signals[name])), 1e-300) for name in self.names}
        self.whole = 1.0

    def other(self, measured: Mapping[str, np.ndarray]) -> SquaredGap:
        """The same yardstick for a log whose sensors were put right."""
        twin = object.__new__(SquaredGap)
        twin.__dict__.update(self.__dict__)
        twin.signals = scored(measured, self.dt)
        return twin

    def errors(self, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """(signals, N) measured less simulated over the signal's spread."""
        shown = scored(simulated, self.dt)
        return np.array([(self.signals[n] - shown[n]) / np.sqrt(self.power[n]) for n in self.names])

    def energy(self, simulated: Mapping[str, np.ndarray]) -> Energy:
        """(signals,) squared gap; large for a run that stopped."""
        floor = np.array([self.noise[n] ** 2 / self.power[n] for n in self.names])
        errors = self.errors(simulated)
        if not np.isfinite(errors).all():
            return np.full(len(self.names), 1e3 * self.whole)
        return np.maximum(np.mean(errors**2, axis=1) - floor, 0.0)
