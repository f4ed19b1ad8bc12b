"""Samples that no sensor of a moving plant gives: spikes, values held over several rows, rows that are missing."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

#: Rows on which a median is taken: spikes of up to three samples stand out of it.
AROUND = 7
#: A spike is this many times what all but 1 % of the samples differ from that median, and as many deviations of noise.
UNUSUAL, NOISE = 10.0, 30.0
#: More of them are no accidents.
FEW = 10
#: Changes of value from which on a pattern in their rows is no chance.
PATTERN = 30


def spikes(values: np.ndarray, sd: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (k,) that stand out of their neighbours, and the values (N,) with these neighbours' median there.

    A spike leaves the range of all else by as much as that range, or is a plain zero, as lost samples are logged.
    """
    usual = median_filter(values, AROUND, mode="nearest")
    off = np.abs(values - usual)
    out = off > max(UNUSUAL * float(np.quantile(off, 0.99)), NOISE * sd)
    if not out.any() or out.all():
        return np.empty(0, dtype=int), values
    out &= (off > np.ptp(values[~out])) | (values == 0.0)
    rows = np.flatnonzero(out)
    return (rows, np.where(out, usual, values)) if rows.size <= FEW else (np.empty(0, dtype=int), values)


def held_over(values: np.ndarray) -> int:
    """Over how many rows each value is repeated, where changes come at multiples of a number of rows alone; else 1."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    return int(np.gcd.reduce(np.diff(changes))) if changes.size > PATTERN else 1


def jump(position: np.ndarray, sd: float) -> int | None:
    """The row at which a position is further than any motion in this log can bring it in a sample; else None.

    A mean speed over five samples holds a fifth of a jump, so that a third of it can't be all motion.
    """
    step = np.abs(np.diff(position))
    at = int(np.argmax(step))
    fastest = float(np.max(np.abs(position[5:] - position[:-5]))) / 5.0
    return at + 1 if step[at] > 3.0 * fastest + NOISE * sd else None
