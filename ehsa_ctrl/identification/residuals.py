"""Measured minus simulated over one shooting window, with its derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError
from ..core.linear_recursion import linear_recursion
from ..core.log import Log
from ..plant.plant import Plant, Sensor
from ..simulation.sensitivity import transitions
from ..simulation.sensors import first_order, first_order_by_lag
from .initial_state import sensor_sd
from .innovations import InnovationsFilter, innovations_filter
from .logged_inputs import acting_drive, logged_inputs
from .plant_log import plant_of_log
from .shooting import ShootingWindow


@dataclass(frozen=True)
class MeasuredChannels:
    """The channels of a log that are compared with the simulation.

    channels (m,), the column of the state that each measures (m,), its noise sd (m,), and the input's noise input_sd.
    """

    channels: tuple[str, ...]
    column: np.ndarray
    sd: np.ndarray
    input_sd: float

    @classmethod
    def of(cls, plant: Plant, log: Log, weights: Mapping[str, float] | None = None) -> MeasuredChannels:
        """The plant's outputs in the log; `weights` are standard deviations that replace the sensors' noise.

        Raises InputError if the log has none of them.
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
class WindowRun:
    """One window simulated: raw residual (N, m), and derivatives of the simulated channels.

    errors (N,): added to the logged input. states (N, n). by_start (N, m, q): by the free states at the start.
    by_parameter (N, m, k). whitening: the innovations filter along this run.
    """

    window: ShootingWindow
    measured: MeasuredChannels
    errors: np.ndarray
    states: np.ndarray
    residual: np.ndarray
    by_start: np.ndarray
    by_parameter: np.ndarray
    whitening: InnovationsFilter


def simulate_window(
    plant: Plant,
    window: ShootingWindow,
    start: np.ndarray,
    names: Sequence[str],
    *,
    errors: np.ndarray | None = None,
    weights: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
) -> WindowRun:
    """Simulate one window from `start` (n,), with derivatives by `names` (symbols and sensor numbers).

    errors (N,) are added to the logged input; zero by default. weights: channel -> standard deviation instead of the
    sensors' noise; the logged input is then taken as exact.

    Raises SimulationError if the run diverges.
    """
    rows = slice(window.first, window.last + 1)
    log, dt = window.log, window.log.sample_time
    plant = plant_of_log(plant, log)
    measured = MeasuredChannels.of(plant, log, weights)
    logged, outer = logged_inputs(plant, log)
    undelayed, logged = acting_drive(plant, logged, dt)
    logged, outer = logged[rows], None if outer is None else outer[rows]
    errors = np.zeros(logged.size) if errors is None else errors
    run = transitions(
        undelayed, [name for name in names if "." not in name], logged + errors, force=outer,
        hold=plant.structure.system.hold, start=start, sample_time=dt, tolerance=tolerance,
    )  # fmt: skip
    sensors = [plant.sensors[channel] for channel in measured.channels]
    scale = np.array([sensor.scale for sensor in sensors])
    delays = np.array([sensor.delay for sensor in sensors]) / dt
    # Only the first window of a log can begin at rest.
    moving = window.first > 0
    filtered = _filtered(run.states[:, measured.column], sensors, dt, moving)
    true = _delayed(filtered, delays)
    simulated = scale * true + np.array([sensor.bias for sensor in sensors])
    begin = np.eye(start.size)[:, list(window.free)]
    # By the initial state the products of the transitions, by a parameter the sum of what each sample adds.
    by_state = linear_recursion(run.by_state, run.by_parameter, begin)[:, measured.column, :]
    by_state = _delayed(_filtered(by_state, sensors, dt, moving), delays) * scale[None, :, None]
    q = len(window.free)
    by_parameter = np.zeros((len(window), len(sensors), len(names)))
    symbol = q
    for column, name in enumerate(names):
        word, dot, channel = name.partition(".")
        if not dot:
            by_parameter[:, :, column] = by_state[:, :, symbol]
            symbol += 1
        elif channel in measured.channels:
            c = measured.channels.index(channel)
            if word == "bias":
                by_parameter[:, c, column] = 1.0
            elif word == "scale":
                by_parameter[:, c, column] = true[:, c]
            else:
                slope = np.gradient(filtered[:, c], dt)
                if word == "filter":
                    slope = -first_order_by_lag(run.states[:, measured.column[c]], sensors[c].filter, dt, moving=moving)
                by_parameter[:, c, column] = -scale[c] * _delayed(slope[:, None], delays[c : c + 1])[:, 0]
    return WindowRun(
        window=window,
        measured=measured,
        errors=errors,
        states=run.states,
        residual=np.column_stack([log[channel][rows] for channel in measured.channels]) - simulated,
        by_start=by_state[:, :, :q],
        by_parameter=by_parameter,
        whitening=innovations_filter(
            run.by_state, run.by_input, measured.column, scale, measured.sd, measured.input_sd
        ),
    )


def _filtered(values: np.ndarray, sensors: Sequence[Sensor], sample_time: float, moving: bool) -> np.ndarray:
    """Columns of values (N, m, ...) through the filters of their sensors."""
    if not any(sensor.filter for sensor in sensors):
        return values
    columns = [first_order(values[:, c], sensor.filter, sample_time, moving=moving) for c, sensor in enumerate(sensors)]
    return np.stack(columns, axis=1)


def _delayed(values: np.ndarray, delays: np.ndarray) -> np.ndarray:
    """Columns of values (N, m, ...) `delays` (m,) samples earlier, constant before the start.

    Between samples by the cubic through the four nearest ones.
    """
    if not delays.any():
        return values
    out = np.zeros_like(values)
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
        for shift, weight in enumerate(weights, -1):
            out[:, c] += weight * values[np.clip(index - whole - shift, 0, len(index) - 1), c]
    return out
