"""From a log to what the balances ask for: states, inputs, measured rates, sliding directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import butter, savgol_filter, sosfiltfilt

from ..core.errors import InputError
from ..core.log import Log
from ..plant.plant import Plant
from .drives import acting_drive, undo_sensor

Method = Literal["weak", "filtered"]

#: A contact slides where its speed is this many standard deviations of its estimate from zero.
SLIDING = 5.0


@dataclass(frozen=True)
class Measured:
    """Signals (N,) by the names that the balances use, and where each contact plainly slides (N,) bool."""

    values: dict[str, np.ndarray]
    slides: dict[str, np.ndarray]
    sample_time: float


def measure(plant: Plant, log: Log, method: Method, cutoff: float) -> Measured:
    """Collect everything of a log that a balance may ask for; what the log does not tell is absent.

    Sensors are undone (filter, delay, bias, scale), and the drive acts after its dead time. A speed without a channel
    is the slope of its position: of a cubic over seven samples ("weak"), or by central differences of the position
    after a fourth-order Butterworth filter at `cutoff` Hz without phase ("filtered").
    """
    system = plant.structure.system
    dt = log.sample_time
    channels = {channel: undo_sensor(plant, log, channel) for channel in system.channels if channel in log.channels}
    if method == "filtered":
        if not 0.0 < cutoff < 0.5 / dt:
            raise InputError(f"cutoff = {cutoff:g} Hz; expected more than 0 and less than {0.5 / dt:g} Hz")
        sos = butter(4, cutoff, fs=1.0 / dt, output="sos")
        smooth = {channel: sosfiltfilt(sos, values) for channel, values in channels.items()}
    else:
        smooth = channels
    values = {f"{channel}_measured": value for channel, value in channels.items()}
    noise: dict[str, float] = {}
    for channel, state in system.outputs.items():
        if channel in channels:
            values[state] = smooth[channel]
            noise[state] = _noise(channels[channel])
    for name in system.inputs:
        if name not in system.drives:
            values[name] = np.zeros(len(log))
        elif (channel := system.drives[name]) in channels:
            # A drive that is held over each sample acts, around an instant, as the mean of two samples.
            held = system.hold == "zero_order"
            acting = channels[channel]
            if name == system.inputs[0]:
                _, acting = acting_drive(plant, acting, dt)
            values[name] = _between(acting) if held else acting
            noise[name] = _noise(channels[channel])
    if "v" not in values and "position" in channels:
        noise["v"] = 0.35 * _noise(channels["position"]) / dt
        values["v"] = (
            np.gradient(smooth["position"], dt)
            if method == "filtered"
            else savgol_filter(channels["position"], min(7, len(log) - 1 + len(log) % 2), 3, deriv=1, delta=dt)
        )
    for name in [*(state.name for state in system.states), *system.inputs]:
        if name in values:
            values[f"{name}_rate"] = np.gradient(values[name], dt) if method == "filtered" else _slope(values[name], dt)
    if "v" in values and "acceleration" in channels:
        values["v_rate"] = channels["acceleration"]
    slides = {}
    for contact in system.all_contacts:
        if contact.velocity in values:
            speed = values[contact.velocity]
            width = min(7, len(log) - 1 + len(log) % 2)
            seen = savgol_filter(speed, width, 2) if method == "weak" else speed
            values[contact.direction] = np.sign(seen)
            slides[contact.name] = np.abs(seen) > SLIDING * noise[contact.velocity]
    return Measured(values, slides, dt)


def _noise(values: np.ndarray) -> float:
    """What changes from sample to sample beyond a smooth signal: a robust standard deviation."""
    fourth = np.abs(np.diff(values, 4))
    return float(np.median(fourth)) / 0.6745 / np.sqrt(70.0)


def _between(values: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (values + np.concatenate([values[:1], values[:-1]])))


def _slope(values: np.ndarray, dt: float) -> np.ndarray:
    """Central differences of fourth order; second order at the ends."""
    slope = np.gradient(values, dt)
    slope[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * dt)
    return np.asarray(slope)
