"""What the bench measures: noise, converter steps and delays on the true signals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.protocol import MEASURED
from ..plant.file import CHANNEL_UNITS
from ..plant.plant import Plant, Sensor
from .trajectory import Trajectory

#: Channel of the log and the signal of the plant it shows.
SIGNALS = {
    "current": "current",
    "speed": "omega",
    "p1": "P_1",
    "p2": "P_2",
    "position": "x",
    "force": "F_cell",
    "velocity": "v",
    "drive_force": "F_M",
}


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

    def sensor(self, channel: str) -> Sensor:
        """The sensor of a channel; an ideal one for a channel that the plant does not have."""
        return self.by_channel.get(channel) or Sensor(channel, CHANNEL_UNITS[channel])

    def noise(self, channel: str, samples: int) -> np.ndarray:
        """White noise (samples,) of one channel, SI units."""
        stream = np.random.default_rng([self.seed, list(SIGNALS).index(channel)])
        return self.sensor(channel).noise * stream.standard_normal(samples)

    def measure(self, channel: str, true: np.ndarray, sample_time: float) -> np.ndarray:
        """What the sensor of `channel` gives for the true signal (N,): delayed, scaled, biased, noisy, rounded."""
        sensor = self.by_channel[channel]
        late = true
        if sensor.delay > 0.0:
            time = sample_time * np.arange(true.size)
            late = np.interp(time - sensor.delay, time, true)
        value = sensor.scale * late + sensor.bias + self.noise(channel, true.size)
        return np.round(value / sensor.step) * sensor.step if sensor.step > 0.0 else value

    def log(self, run: Trajectory) -> dict[str, np.ndarray]:
        """All channels of a run as a bench would log them."""
        dt = float(run.time[1] - run.time[0])
        system = run.plant.structure.system
        there = {*system.inputs, *(state.name for state in system.states), system.cell}
        return {
            channel: self.measure(channel, run[signal], dt)
            for channel, signal in SIGNALS.items()
            if channel in system.channels and signal in there
        }

    def tables(self, samples: int, sample_time: float) -> tuple[np.ndarray, ...]:
        """For the engine, of what a controller gets: scale (5,), noise with bias (samples, 5), resolution (5,) and
        delay in samples (5,)."""
        sensors = [self.sensor(channel) for channel in MEASURED]
        scale = np.array([sensor.scale for sensor in sensors])
        noise = np.column_stack([self.noise(sensor.channel, samples) + sensor.bias for sensor in sensors])
        resolution = np.array([sensor.step for sensor in sensors])
        delay = np.array([sensor.delay for sensor in sensors]) / sample_time
        return scale, np.ascontiguousarray(noise), resolution, delay
