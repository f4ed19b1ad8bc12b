"""The signals of the balances from a log: states, inputs, their rates, and the direction of sliding."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.signal import butter, savgol_filter, sosfiltfilt

from ..core.errors import InputError
from ..core.log import Log
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from .logged_inputs import acting_drive, undo_sensor

Method = Literal["weak", "filtered"]

#: A contact slides where its speed is this many standard deviations of its estimate from zero.
SLIDING = 5.0
#: Samples of a local polynomial, and the noise gain of its cubic's slope.
WIDTH, SLOPE_GAIN = 7, 0.35


@dataclass(frozen=True)
class MeasuredSignals:
    """Signals (N,) by the names that the balances use, and where each contact clearly slides (N,) bool."""

    values: dict[str, np.ndarray]
    slides: dict[str, np.ndarray]


def balance_signals(plant: Plant, log: Log, method: Method, cutoff: float) -> MeasuredSignals:
    """All signals of a log that a balance may need; those that can't be measured or derived are absent.

    Sensors are undone (filter, delay, bias, scale), and the input acts after its dead time. A speed without a channel
    is the slope of its position: of a cubic over seven samples ("weak"), or by central differences of the position
    after a fourth-order zero-phase Butterworth filter at `cutoff` Hz ("filtered"). States of effects follow from the
    log where they can (`EffectState.along`).
    """
    system, dt, filtered = plant.structure.system, log.sample_time, method == "filtered"
    channels = {channel: undo_sensor(plant, log, channel) for channel in system.channels if channel in log.channels}
    smooth = channels
    if filtered:
        if not 0.0 < cutoff < 0.5 / dt:
            raise InputError(f"cutoff = {cutoff:g} Hz; expected more than 0 and less than {0.5 / dt:g} Hz")
        sos = butter(4, cutoff, fs=1.0 / dt, output="sos")
        smooth = {channel: sosfiltfilt(sos, values) for channel, values in channels.items()}
    width = min(WIDTH, len(log) - 1 + len(log) % 2)
    values = {f"{channel}_measured": value for channel, value in channels.items()}
    values |= {name: np.full(len(log), value) for name, value in log.settings.items()}
    noise: dict[str, float] = {}
    for channel, state in system.outputs.items():
        if channel in channels:
            values[state] = smooth[channel]
            noise[state] = _noise(channels[channel])
    for name in system.inputs:
        if name not in system.drives:
            values[name] = np.zeros(len(log))
        elif (channel := system.drives[name]) in channels:
            acting = channels[channel]
            if name == system.inputs[0]:
                _, acting = acting_drive(plant, acting, dt)
            # Around an instant a zero-order-held input acts as the mean of two samples.
            held = system.hold == "zero_order"
            values[name] = 0.5 * (acting + np.concatenate([acting[:1], acting[:-1]])) if held else acting
            noise[name] = _noise(channels[channel])
    shown = {state: channel for channel, state in system.positions.items() if channel in channels}
    for velocity, position in system.slopes.items():
        if velocity in values or position not in shown:
            continue
        measured = channels[shown[position]]
        noise[velocity] = SLOPE_GAIN * _noise(measured) / dt
        slope = np.gradient(smooth[shown[position]], dt)
        values[velocity] = slope if filtered else savgol_filter(measured, width, 3, deriv=1, delta=dt)
    for name in [*(state.name for state in system.states), *system.inputs]:
        if name in values:
            values[f"{name}_rate"] = np.gradient(values[name], dt) if filtered else _slope(values[name], dt)
    measured_log = replace(log, channels={**log.channels, **channels})
    for effect in map(EFFECTS.__getitem__, plant.structure.effects):
        # States without a sensor, from the signals that drive them.
        values |= {state.name: state.along(measured_log, plant.values) for state in effect.states if state.along}
    for contact in system.all_contacts:
        if contact.velocity in values and contact.acceleration_channel in channels:
            values[f"{contact.velocity}_rate"] = channels[contact.acceleration_channel]
    slides = {}
    for contact in system.all_contacts:
        if contact.velocity in values:
            speed = values[contact.velocity] if filtered else savgol_filter(values[contact.velocity], width, 2)
            values[contact.direction] = np.sign(speed)
            slides[contact.name] = np.abs(speed) > SLIDING * noise[contact.velocity]
    return MeasuredSignals(values, slides)


def _noise(values: np.ndarray) -> float:
    """Robust standard deviation of fourth differences over that of unit noise: what a smooth signal hardly has."""
    fourth = np.abs(np.diff(values, 4))
    return float(np.median(fourth)) / 0.6745 / np.sqrt(70.0)


def _slope(values: np.ndarray, dt: float) -> np.ndarray:
    """Central differences of fourth order; second order at the ends."""
    slope = np.gradient(values, dt)
    slope[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * dt)
    return np.asarray(slope)
