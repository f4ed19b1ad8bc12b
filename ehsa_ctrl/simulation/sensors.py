"""Sensor models: filter, delay, scale, bias, noise and quantisation of the true signals."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np

from ..core.controller_interface import MEASURED
from ..core.log import CHANNELS
from ..plant.plant import Plant, Sensor
from .trajectory import Trajectory

#: Channels in the order of their noise streams; for other channels of a system the name gives the stream.
STREAMS = ("current", "speed", "p1", "p2", "position", "force", "velocity", "drive_force")


@dataclass(frozen=True)
class Sensors:
    """The sensors of a run and the seed of their noise.

    Each channel has its own noise stream, so that a change of one sensor does not affect the noise of the others.
    """

    by_channel: dict[str, Sensor]
    seed: int = 0

    @classmethod
    def of(cls, plant: Plant, *, seed: int = 0, noise: bool = True, ideal: bool = False) -> Sensors:
        """Sensors of the plant. noise=False removes their noise, ideal=True all their errors."""
        sensors = dict(plant.sensors)
        if ideal:
            sensors = {channel: Sensor(channel, sensor.unit) for channel, sensor in sensors.items()}
        elif not noise:
            sensors = {channel: replace(sensor, noise=0.0) for channel, sensor in sensors.items()}
        return cls(sensors, seed)

    def sensor(self, channel: str) -> Sensor:
        """The sensor of a channel; an ideal one for a channel that the plant lacks."""
        return self.by_channel.get(channel) or Sensor(channel, CHANNELS[channel].unit)

    def noise(self, channel: str, samples: int) -> np.ndarray:
        """White noise (samples,) of one channel, SI units."""
        stream = STREAMS.index(channel) if channel in STREAMS else zlib.crc32(channel.encode())
        return self.sensor(channel).noise * np.random.default_rng([self.seed, stream]).standard_normal(samples)

    def measure(self, channel: str, true: np.ndarray, sample_time: float, *, held: bool = False) -> np.ndarray:
        """Reading of `channel` for the true signal (N,): as `noise_free_reading`, with noise and quantisation."""
        sensor = self.by_channel[channel]
        value = noise_free_reading(sensor, true, sample_time, held=held) + self.noise(channel, true.size)
        return np.round(value / sensor.step) * sensor.step if sensor.step > 0.0 else value

    def log(self, run: Trajectory) -> dict[str, np.ndarray]:
        """All channels of a run as a bench would log them."""
        dt = float(run.time[1] - run.time[0])
        system = run.plant.structure.system
        signals = {channel: name for name, channel in system.drives.items()} | dict(system.outputs)
        if system.cell is not None:
            signals["force"] = system.cell
        order = (*STREAMS, *(channel for channel in signals if channel not in STREAMS))
        held = set(system.drives.values()) if run.hold == "zero_order" else set()
        return {
            channel: self.measure(channel, run[signals[channel]], dt, held=channel in held)
            for channel in order
            if channel in signals
        }

    def tables(self, samples: int, sample_time: float) -> tuple[np.ndarray, ...]:
        """Tables of the compiled closed loop: scale (5,), noise with bias (samples, 5), quantisation step (5,), delay
        in samples (5,), weights of the filters (5, 3)."""
        sensors = [self.sensor(channel) for channel in MEASURED]
        scale = np.array([sensor.scale for sensor in sensors])
        noise = np.column_stack([self.noise(sensor.channel, samples) + sensor.bias for sensor in sensors])
        resolution = np.array([sensor.step for sensor in sensors])
        delay = np.array([sensor.delay for sensor in sensors]) / sample_time
        weights = np.array([filter_weights(sensor.filter, sample_time) for sensor in sensors])
        return scale, np.ascontiguousarray(noise), resolution, delay, weights


def noise_free_reading(sensor: Sensor, true: np.ndarray, sample_time: float, *, held: bool = False) -> np.ndarray:
    """Reading of a true signal (N,) without noise and quantisation: filtered, delayed, scaled and biased.

    held: the signal is held over each sample, as that of a drive; by default it is linear between samples.
    """
    late = first_order(true, sensor.filter, sample_time, held=held)
    if sensor.delay > 0.0:
        time = sample_time * np.arange(true.size)
        late = np.interp(time - sensor.delay, time, late)
    return np.asarray(sensor.scale * late + sensor.bias)


def filter_weights(lag: float, sample_time: float, *, held: bool = False) -> tuple[float, float, float]:
    """(a, b, c) of y_k = a y_(k-1) + b u_k + c u_(k-1), the exact solution of lag y' + y = u.

    u is linear between samples. held: u_k is held over its sample, and y_k is the value at the end of that sample.
    """
    if lag <= 0.0:
        return 0.0, 1.0, 0.0
    a = math.exp(-sample_time / lag)
    if held:
        return a, 1.0 - a, 0.0
    mean = lag / sample_time * (1.0 - a)
    return a, 1.0 - mean, mean - a


def first_order(
    signal: np.ndarray, lag: float, sample_time: float, *, held: bool = False, moving: bool = False
) -> np.ndarray:
    """A signal (N, ...) filtered by 1 / (lag s + 1), see `filter_weights`; unchanged for lag = 0.

    The filter starts in steady state at the first sample; moving: in the steady state of a ramp with the slope between
    the first two samples.
    """
    if lag <= 0.0:
        return signal
    from scipy.signal import lfilter

    a, b, c = filter_weights(lag, sample_time, held=held)
    before = -lag / sample_time * (signal[1:2] - signal[:1]) if moving else 0.0
    out, _ = lfilter([b, c], [1.0, -a], signal, axis=0, zi=(1.0 - b) * signal[:1] + before)
    return np.asarray(out)


def first_order_by_lag(signal: np.ndarray, lag: float, sample_time: float, *, moving: bool = False) -> np.ndarray:
    """Derivative (N,) of `first_order` with respect to lag [unit of the signal per s]; valid at lag = 0 too."""
    from scipy.signal import lfilter

    a, _, _ = filter_weights(lag, sample_time)
    a_rate = a * sample_time / lag**2 if lag > 0.0 else 0.0
    mean_rate = (1.0 - a) / sample_time - (a_rate * lag / sample_time)
    out = np.empty_like(signal)
    out[0] = -(signal[1] - signal[0]) / sample_time if moving else 0.0
    y = first_order(signal, lag, sample_time, moving=moving)
    change = a_rate * (y[:-1] - signal[:-1]) - mean_rate * np.diff(signal)
    out[1:], _ = lfilter([1.0], [1.0, -a], change, zi=a * out[:1])
    return out
