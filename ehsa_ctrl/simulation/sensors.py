"""What the bench measures: noise, converter steps and delays on the true signals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.protocol import MEASURED
from ..plant.plant import Plant, Sensor
from .trajectory import Trajectory

#: Channel of the log and the signal of the plant it shows.
SIGNALS = {"current": "current", "speed": "omega", "p1": "P_1", "p2": "P_2", "position": "x", "force": "F_cell"}


@dataclass(frozen=True)
class Sensors:
    """The sensors of a run and the seed of their noise.

    Each channel has a noise stream of its own, so that changing one sensor leaves the others' noise as it was.
    """

    by_channel: dict[str, Sensor]
    seed: int = 0

    @classmethod
    def of(cls, plant: Plant, *, seed: int = 0, noise: bool = True, ideal: bool = False) -> Sensors:
        """The plant's sensors; without noise if noise=False; without steps and delays as well if ideal=True."""
        sensors = dict(plant.sensors)
        if ideal:
            sensors = {channel: Sensor(channel, sensor.unit) for channel, sensor in sensors.items()}
        elif not noise:
            sensors = {channel: replace(sensor, noise=0.0) for channel, sensor in sensors.items()}
        return cls(sensors, seed)

    def noise(self, channel: str, samples: int) -> np.ndarray:
        """White noise (samples,) of one channel, SI units."""
        stream = np.random.default_rng([self.seed, list(SIGNALS).index(channel)])
        return self.by_channel[channel].noise * stream.standard_normal(samples)

    def measure(self, channel: str, true: np.ndarray, sample_time: float) -> np.ndarray:
        """What the sensor of `channel` gives for the true signal (N,): delayed, noisy, rounded."""
        sensor = self.by_channel[channel]
        late = true
        if sensor.delay > 0.0:
            time = sample_time * np.arange(true.size)
            late = np.interp(time - sensor.delay, time, true)
        value = late + self.noise(channel, true.size)
        return np.round(value / sensor.step) * sensor.step if sensor.step > 0.0 else value

    def log(self, run: Trajectory) -> dict[str, np.ndarray]:
        """All channels of a run as a bench would log them."""
        dt = float(run.time[1] - run.time[0])
        return {channel: self.measure(channel, run[signal], dt) for channel, signal in SIGNALS.items()}

    def tables(self, samples: int, sample_time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For the engine: noise (samples, 5), resolution (5,) and delay in samples (5,) of what a controller gets."""
        noise = np.column_stack([self.noise(channel, samples) for channel in MEASURED])
        resolution = np.array([self.by_channel[channel].step for channel in MEASURED])
        delay = np.array([self.by_channel[channel].delay for channel in MEASURED]) / sample_time
        return np.ascontiguousarray(noise), resolution, delay
