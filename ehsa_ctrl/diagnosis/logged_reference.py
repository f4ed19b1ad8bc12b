"""The reference of a log by the samples of its controller, and the controller's output on the logged readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.controller_interface import MEASURED, Controller
from ..core.errors import InputError
from ..core.log import REFERENCES, Log

#: Lags that are looked for, in samples of the controller. Engineering judgement: computation and a fieldbus take a few.
LAGS = range(6)
#: A lag counts if the output then agrees better with the logged drive by this factor. Engineering judgement.
BETTER = 0.8
#: Largest relative difference of sample times that still counts as a whole ratio; clocks differ by some 1e-4.
RATIO_TOLERANCE = 1e-3


def _ratio(log: Log, controller: Controller) -> int:
    """Samples of the log per sample of the controller. Raises InputError unless it is a whole number."""
    ratio = controller.sample_time / log.sample_time
    whole = max(int(round(ratio)), 1)
    if abs(ratio / whole - 1.0) > RATIO_TOLERANCE:
        raise InputError(
            f"{log.path or 'the log'}: has a sample time of {log.sample_time:g} s, controller {controller.name} of "
            f"{controller.sample_time:g} s; a closed-loop replay needs one that is a whole multiple of the log's: "
            "give the controller of this log, or --resample the log to its rate"
        )
    return whole


def sampled_by(log: Log, controller: Controller) -> Log:
    """The log at the samples of the controller. Raises InputError for a sample time that does not fit."""
    every = _ratio(log, controller)
    if every == 1:
        return log
    channels = {name: values[::every] for name, values in log.channels.items()}
    return replace(log, time=log.time[::every], channels=channels, before=None)


def reference_of(log: Log, controller: Controller) -> np.ndarray:
    """(N, 3) position, velocity and acceleration that the controller was asked for, at its samples.

    Velocity and acceleration that the log lacks are slopes of the position. The smaller of the two slopes beside a
    sample is taken, or zero where they have opposite signs (minmod), so that a step has no velocity.

    Raises InputError for a log without the channel `reference`, and as `sampled_by`.
    """
    sampled = sampled_by(log, controller)
    name, *others = REFERENCES
    if name not in log.channels:
        raise InputError(
            f"{log.path or 'the log'}: has no channel {name}, which the closed-loop replay with {controller.name} "
            "follows; record the controller's target position, or map its column as reference in the plant's [log] "
            "table"
        )
    columns = [sampled[name]]
    for channel in others:
        known = channel in log.channels
        columns.append(sampled[channel] if known else _slope(columns[-1], sampled.sample_time))
    return np.column_stack(columns)


def _slope(values: np.ndarray, sample_time: float) -> np.ndarray:
    """Slope (N,) by the minmod limiter; zero at both ends."""
    steps = np.diff(values) / sample_time
    before, after = np.append(0.0, steps), np.append(steps, 0.0)
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0.0, smaller, 0.0)


def controller_output(controller: Controller, reference: np.ndarray, log: Log) -> np.ndarray | None:
    """(N,) output of the controller on the logged readings, N rows of `reference`; None without a reading it needs."""
    reads = getattr(getattr(controller, "law", None), "reads", MEASURED)
    if any(name not in log.channels for name in reads):
        return None
    n = len(reference)
    rows = np.column_stack([log[name][:n] if name in log.channels else np.zeros(n) for name in MEASURED])
    memory, compiled, settings = controller.initial_memory(), controller.compiled, controller.settings()
    if getattr(controller, "follows_force", False):
        # A log has no force target; a compiled law that follows one reads four numbers a row.
        reference = np.column_stack([reference, np.zeros(n)])
    return np.array(
        [
            controller.step(r, m, memory) if compiled is None else compiled(r, m, memory, settings)
            for r, m in zip(np.ascontiguousarray(reference), rows, strict=True)
        ]
    )


def output_lag(drive: np.ndarray, output: np.ndarray | None, lags: Sequence[int] = LAGS) -> tuple[int, float]:
    """Lag in samples of the logged drive (N,) behind the output (N,), and their RMS difference over the drive's spread.

    Without an output, or for a constant drive: the first lag, nan.
    """
    spread = float(np.std(drive))
    if output is None or spread == 0.0:
        return lags[0], float("nan")
    n = drive.size
    differences = [float(np.sqrt(np.mean((drive[lag:] - output[: n - lag]) ** 2))) / spread for lag in lags]
    best = int(np.argmin(differences))
    if differences[best] > BETTER * differences[0]:
        best = 0
    return lags[best], differences[best]
