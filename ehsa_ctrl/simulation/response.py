"""Conversion between runs and time responses of python-control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.log import check_time
from ..plant.plant import Plant

if TYPE_CHECKING:
    import control

    from .trajectory import Trajectory


def to_response(run: Trajectory) -> control.TimeResponseData:
    """A run as a time response of python-control: inputs (2, N), states (n, N), outputs (n or more, N), SI units.

    Labels are those of `to_iosystem`. A run with two pressures has the output dP too, so that all outputs of
    `three_state` and `four_state` are found by name: response.to_pandas()["dP"].
    """
    import control

    names = [state.name for state in run.plant.structure.equations.states]
    extra = ["dP"] if {"P_1", "P_2"} <= set(names) else []
    inputs = list(run.plant.structure.system.inputs)
    return control.TimeResponseData(
        run.time,
        np.array([run[name] for name in (*names, *extra)]),
        run.states.T.copy(),
        np.array([run[name] for name in inputs]),
        issiso=False,
        output_labels=[*names, *extra],
        state_labels=names,
        input_labels=inputs,
        title=f"{run.plant.name} ({run.plant.model})",
        sysname=run.plant.name,
    )


def is_response(given: Any) -> bool:
    """Whether an object is a time response of python-control, without importing that."""
    return hasattr(given, "output_labels") and hasattr(given, "input_labels") and hasattr(given, "time")


def signal_of(response: control.TimeResponseData, name: str) -> np.ndarray | None:
    """A signal (N,) of a response by its label, first among inputs, then outputs; None without such a label.

    Raises InputError for a response with several traces, which is ambiguous.
    """
    if getattr(response, "ntraces", 0) > 1:
        raise InputError(
            f"the time response has {response.ntraces} traces, one per input; expected one, as from "
            "step_response(system[:, 0])"
        )
    samples = np.size(response.time)
    for labels, values in ((response.input_labels, response.inputs), (response.output_labels, response.outputs)):
        if values is not None and labels is not None and name in labels:
            return np.reshape(np.asarray(values, dtype=float), (len(labels), samples))[list(labels).index(name)]
    return None


def drives_of(plant: Plant, response: control.TimeResponseData) -> tuple[np.ndarray, np.ndarray | None, float]:
    """The plant's two inputs (N,) from a response (None for a missing second one), and the sample time [s].

    Raises InputError for a response without the first input, or with time that is not uniform.
    """
    first, second = plant.structure.system.inputs
    current = signal_of(response, first)
    if current is None:
        known = ", ".join([*(response.input_labels or []), *(response.output_labels or [])])
        raise InputError(f"the time response has no signal {first!r}, which drives {plant.name}; it has {known}")
    time = np.asarray(response.time, dtype=float)
    if time.size < 2:
        raise InputError(f"the time response has {time.size} samples; expected at least 2")
    check_time("the time response", time, first_row=1)
    return current, signal_of(response, second), float((time[-1] - time[0]) / (time.size - 1))
