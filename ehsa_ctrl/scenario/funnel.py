"""A tube around a recorded signal, with tolerances in value and in time.

The tube is what a rectangle, half as wide as the tolerance in time and half as high as the one in value, covers when
its centre follows the recorded line. A signal within it may come a little earlier or later, and a little higher or
lower; a steep flank costs no more than a flat part. Tools for regression of simulations compare so (funnel of the
Lawrence Berkeley National Laboratory; csv-compare of the Modelica Association).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Tube(NamedTuple):
    """Lower and upper bound (N,) at given times."""

    lower: np.ndarray
    upper: np.ndarray


class Exit(NamedTuple):
    """Where a signal lies farthest outside its tube: time [s], value, and by how much beyond the bound."""

    time: float
    value: float
    by: float


def tube(
    time: np.ndarray, recorded: np.ndarray, at: np.ndarray, *, value_tolerance: float, time_tolerance: float
) -> Tube:
    """The tube around a line of recorded points, exact at the times `at`.

    Parameters
    ----------
    time, recorded: (M,) growing times [s] and values; before the first and after the last point the value is held.
    at: (N,) times at which the tube is wanted.
    value_tolerance, time_tolerance: half height, in the signal's unit, and half width [s] of the rectangle.
    """
    early, late = at - time_tolerance, at + time_tolerance
    ends = np.interp(early, time, recorded), np.interp(late, time, recorded)
    upper, lower = np.maximum(*ends), np.minimum(*ends)
    first, stop = np.searchsorted(time, early, side="left"), np.searchsorted(time, late, side="right")
    # A line between points is highest at one of them: those within the window, beside its two ends.
    for k in np.flatnonzero(stop > first):
        within = recorded[first[k] : stop[k]]
        upper[k], lower[k] = max(upper[k], within.max()), min(lower[k], within.min())
    return Tube(lower - value_tolerance, upper + value_tolerance)


def worst_exit(at: np.ndarray, values: np.ndarray, bounds: Tube) -> Exit | None:
    """The sample that lies farthest outside the tube; None if all lie within."""
    beyond = np.maximum(values - bounds.upper, bounds.lower - values)
    k = int(np.argmax(beyond))
    return Exit(float(at[k]), float(values[k]), float(beyond[k])) if beyond[k] > 0.0 else None
