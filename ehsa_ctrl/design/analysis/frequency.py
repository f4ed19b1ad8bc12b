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


def discrete_response(system: control.StateSpace, omega: Any) -> np.ndarray:
    """Response (n, outputs, inputs) of a discrete system at omega (n,) [rad/s]: C (zI - A)^-1 B + D on the unit circle.

    All frequencies are solved for at once, which for small systems is some ten times as fast as one after the other.
    """
    z = np.exp(1j * np.atleast_1d(np.asarray(omega, dtype=float)) * float(system.dt))
    if system.nstates == 0:
        return np.broadcast_to(system.D.astype(complex), (z.size, *system.D.shape))
    shifted = z[:, None, None] * np.eye(system.nstates) - system.A
    return (
        np.asarray(system.C @ np.linalg.solve(shifted, np.broadcast_to(system.B, (z.size, *system.B.shape)))) + system.D
    )
