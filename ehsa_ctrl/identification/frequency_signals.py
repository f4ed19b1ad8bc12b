"""Signals of a frequency response: the outputs of logs, and the responses of sampled models to the same drive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS, Log
from ..plant.plant import Plant

if TYPE_CHECKING:
    import control

#: Pressure difference p1 - p2 in place of both pressures.
DIFFERENCE = "pressure_difference"


def output_signals(plant: Plant, logs: Sequence[Log]) -> dict[str, tuple[list[np.ndarray], str]]:
    """Output -> its signal (N_i,) in each log, and its SI unit; both pressures as their difference."""
    states = plant.structure.system.outputs
    names = [name for name in states if all(name in log.channels for log in logs)]
    found = {}
    for name in names:
        if name == "p1" and "p2" in names:
            found[DIFFERENCE] = [log["p1"] - log["p2"] for log in logs], CHANNELS["p1"].unit
        elif name != "p2" or "p1" not in names:
            found[name] = [log[name] for log in logs], CHANNELS[name].unit
    if not found:
        raise InputError(f"{logs[0].name}: has none of the outputs {', '.join(states)}")
    return found


def model_response(
    system: control.StateSpace, plant: Plant, output: str, frequency: np.ndarray, sample_time: float
) -> np.ndarray:
    """Response (n,) of the sampled model, drive held over a sample, at the frequencies (n,) [Hz]."""
    from scipy.signal import cont2discrete

    states, labels = plant.structure.system.outputs, list(system.output_labels)
    if output != DIFFERENCE:
        row = system.C[labels.index(states[output])]
    elif "dP" in labels:
        row = system.C[labels.index("dP")]
    else:
        row = system.C[labels.index(states["p1"])] - system.C[labels.index(states["p2"])]
    b = system.B[:, :1]
    a, b, c, *_ = cont2discrete((system.A, b, row[None, :], np.zeros((1, 1))), sample_time)
    z = np.exp(2j * np.pi * frequency * sample_time)
    shifted = z[:, None, None] * np.eye(len(a)) - a
    return np.asarray((c @ np.linalg.solve(shifted, np.broadcast_to(b, (z.size, *b.shape))))[:, 0, 0])
