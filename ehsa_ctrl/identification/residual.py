"""Measured minus simulated over one window, with its derivatives, as a least-squares problem takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..plant.plant import Plant
from ..simulation.sensitivity import Transitions, transitions
from ..simulation.sensors import by_filter, first_order
from .drives import acting_drive, logged_drives
from .whitening import accumulate, filter_gains, input_errors, whiten
from .window import Window, sensor_sd


@dataclass(frozen=True)
class Measurement:
    """The channels of a log that a simulation is held against.

    channels (m,), the column of the state that each measures (m,), its noise (m,), and the noise of the drive's log.
    """

    channels: tuple[str, ...]
    column: np.ndarray
    sd: np.ndarray
    input_sd: float

    @classmethod
    def of(cls, plant: Plant, log: Log, weights: Mapping[str, float] | None = None) -> Measurement:
        """What of a plant's outputs is in the log; `weights` are standard deviations instead of the sensors'.

        Raises InputError if nothing is.
        """
        system = plant.structure.system
        channels = tuple(channel for channel in system.outputs if channel in log.channels)
        if not channels:
            raise InputError(
                f"{log.path or 'the log'}: has none of the channels {', '.join(system.outputs)} to compare with"
            )
        drive = system.drives[system.inputs[0]]
        return cls(
            channels=channels,
            column=np.array([plant.structure.equations.index(system.outputs[channel]) for channel in channels]),
            sd=np.array([sensor_sd(plant, log, c) if weights is None else weights[c] for c in channels]),
            input_sd=plant.sensors[drive].sd if drive in plant.sensors and weights is None else 0.0,
        )


@dataclass(frozen=True)
class Whitening:
    """A fixed linear operator on measurements: the filter along one run, see `whitening.py`."""

    by_state: np.ndarray
    by_input: np.ndarray
    column: np.ndarray
    scale: np.ndarray
    gains: np.ndarray
    spread: np.ndarray
    input_sd: float

    def __call__(self, values: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """(N, m, q) measurements to (N, m, q) standard deviations; errors (N,) are those the run has taken in."""
        return whiten(
            self.by_state, self.by_input, self.column, self.scale, self.gains, self.spread, values, errors
        )  # fmt: skip

    def errors(self, white: np.ndarray) -> np.ndarray:
        """The input's errors (N,) behind a whitened residual (N, m)."""
        return input_errors(
            self.by_state, self.by_input, self.column, self.scale, self.gains, self.spread, white, self.input_sd
        )


@dataclass(frozen=True)
class WindowRun:
    """One window simulated: raw residual (N, m), and its derivatives with opposite sign, those of the simulation.

    errors (N,): what was added to the logged drive. by_start (N, m, q): by the free states at the start.
    by_parameter (N, m, k).
    """

    window: Window
    measurement: Measurement
    errors: np.ndarray
    states: np.ndarray
    residual: np.ndarray
    by_start: np.ndarray
    by_parameter: np.ndarray
    whitening: Whitening


def run_window(
    plant: Plant,
    window: Window,
    start: np.ndarray,
    names: Sequence[str],
    *,
    errors: np.ndarray | None = None,
    weights: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
) -> WindowRun:
    """Simulate one window from `start` (n,) and differentiate by `names` (symbols and sensor words).

    errors (N,) are added to the logged drive; none by default. weights: channel -> standard deviation; that of the
    sensors and of the drive's log by default, with weights the drive's log is taken as exact.

    Raises SimulationError if the run can't be finished.
    """
    rows = slice(window.first, window.last + 1)
    log = window.log
    measurement = Measurement.of(plant, log, weights)
    logged, outer = logged_drives(plant, log)
    prompt, logged = acting_drive(plant, logged, log.sample_time)
    logged, outer = logged[rows], None if outer is None else outer[rows]
    errors = np.zeros(logged.size) if errors is None else errors
    current = logged + errors
    symbols = [name for name in names if "." not in name]
    run = transitions(
        prompt, symbols, current, force=outer, hold=plant.structure.system.hold, start=start,
        sample_time=log.sample_time, tolerance=tolerance,
    )  # fmt: skip
    begin = np.eye(start.size)[:, list(window.free)]
    derivatives = accumulate(run.by_state, run.by_parameter, begin)
    sensors = [plant.sensors[channel] for channel in measurement.channels]
    scale = np.array([sensor.scale for sensor in sensors])
    delays = np.array([sensor.delay for sensor in sensors]) / log.sample_time
    # Only a log's first window can begin at rest.
    moving = window.first > 0
    filters, dt = [sensor.filter for sensor in sensors], log.sample_time
    seen = _filtered(run.states[:, measurement.column], filters, dt, moving)
    true = _late(seen, delays)
    by_state = _filtered(derivatives[:, measurement.column, :], filters, dt, moving)
    by_state = _late(by_state, delays) * scale[None, :, None]
    simulated = scale * true + np.array([sensor.bias for sensor in sensors])
    measured = np.column_stack([log[channel][rows] for channel in measurement.channels])
    q = len(window.free)
    by_parameter = np.zeros((len(window), len(sensors), len(names)))
    symbol = 0
    for column, name in enumerate(names):
        word, dot, channel = name.partition(".")
        if not dot:
            by_parameter[:, :, column] = by_state[:, :, q + symbol]
            symbol += 1
            continue
        if channel not in measurement.channels:
            continue
        c = measurement.channels.index(channel)
        if word == "bias":
            by_parameter[:, c, column] = 1.0
        elif word == "scale":
            by_parameter[:, c, column] = true[:, c]
        else:
            slope = np.gradient(seen[:, c], dt)
            if word == "filter":
                slope = -by_filter(run.states[:, measurement.column[c]], filters[c], dt, moving=moving)
            by_parameter[:, c, column] = -scale[c] * _late(slope[:, None], delays[c : c + 1])[:, 0]
    return WindowRun(
        window=window,
        measurement=measurement,
        errors=errors,
        states=run.states,
        residual=measured - simulated,
        by_start=by_state[:, :, :q],
        by_parameter=by_parameter,
        whitening=_whitening(run, measurement, scale),
    )


def _whitening(run: Transitions, measurement: Measurement, scale: np.ndarray) -> Whitening:
    by_state, by_input = np.ascontiguousarray(run.by_state), np.ascontiguousarray(run.by_input)
    gains, spread = filter_gains(by_state, by_input, measurement.column, scale, measurement.sd, measurement.input_sd)
    return Whitening(by_state, by_input, measurement.column, scale, gains, spread, measurement.input_sd)


def _filtered(values: np.ndarray, filters: Sequence[float], sample_time: float, moving: bool) -> np.ndarray:
    """Columns of values (N, m, ...) through the filters [s] of their sensors."""
    if not any(filters):
        return values
    columns = [first_order(values[:, c], lag, sample_time, moving=moving) for c, lag in enumerate(filters)]
    return np.stack(columns, axis=1)


def _late(values: np.ndarray, delays: np.ndarray) -> np.ndarray:
    """Columns of values (N, m, ...) as they were `delays` (m,) samples ago; before the start they stand still.

    Between samples by the cubic through the four nearest ones.
    """
    if not delays.any():
        return values
    out = np.empty_like(values)
    index = np.arange(values.shape[0])
    for c, delay in enumerate(delays):
        whole = int(np.floor(delay))
        t = delay - whole
        weights = (
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        )
        out[:, c] = 0.0
        for shift, weight in enumerate(weights, -1):
            out[:, c] += weight * values[np.clip(index - whole - shift, 0, None).clip(max=len(index) - 1), c]
    return out
