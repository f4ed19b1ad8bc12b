"""Frequency responses of sampled loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import control


def sampled_response(system: control.StateSpace, output: str, omega: Any, sample_time: float) -> Any:
    """Response from the current to `output` at omega [rad/s], with the half sample that holding the current costs."""
    row = system.output_labels.index(output)
    response = np.asarray(system(1j * np.asarray(omega)))[row, 0]
    return response * np.exp(-0.5j * np.asarray(omega) * sample_time)
