"""Faults in the samples of a single channel: spikes, repeated values, clipping, missing rows."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

# The thresholds are engineering judgement: loose, so that a sound log is not rejected.

#: Rows of the running median, which removes spikes of up to three samples.
MEDIAN_ROWS = 7
#: A spike differs from the median by this multiple of the 99 % quantile of all samples, and of the noise.
SPIKE_RATIO, NOISE_RATIO = 10.0, 30.0
#: Largest number of spikes; more are a property of the signal.
MAX_SPIKES = 10
#: Number of changes of value from which a regular pattern of their rows is not a coincidence.
MIN_CHANGES = 30
#: An input is clipped if this share of the samples, and this multiple of the neighbouring bins, is at one end.
CLIPPED_SHARE, CLIPPED_RATIO = 0.01, 5.0
#: A continuous signal has at most this share of the inner samples in its ten fullest bins.
CONTINUOUS = 0.5
#: Smallest number of bins of a histogram that can separate a continuous signal from steps.
MIN_BINS = 20
#: Number of exact repeats in a row from which an output may be clipped, and expected number of such runs by chance.
REPEATS, BY_CHANCE = 5, 0.01


def spikes(values: np.ndarray, sd: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (k,) of spikes, and the values (N,) with spikes replaced by the median of their neighbours.

    A spike deviates by more than the range of the other samples, or is zero, as a lost sample is often logged.
    """
    usual = median_filter(values, MEDIAN_ROWS, mode="nearest")
    off = np.abs(values - usual)
    out = off > max(SPIKE_RATIO * float(np.quantile(off, 0.99)), NOISE_RATIO * sd)
    if not out.any() or out.all():
        return np.empty(0, dtype=int), values
    out &= (off > np.ptp(values[~out])) | (values == 0.0)
    rows = np.flatnonzero(out)
    return (rows, np.where(out, usual, values)) if rows.size <= MAX_SPIKES else (np.empty(0, dtype=int), values)


def hold_length(values: np.ndarray) -> int:
    """Number of rows for which each value is repeated, if values change only at multiples of it; else 1."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    return int(np.gcd.reduce(np.diff(changes))) if changes.size > MIN_CHANGES else 1


def jump(position: np.ndarray, sd: float) -> int | None:
    """The row at which a position changes faster than any motion of this log, else None.

    The mean speed over five samples contains a fifth of a jump, so that three times that speed can't all be motion.
    """
    step = np.abs(np.diff(position))
    at = int(np.argmax(step))
    fastest = float(np.max(np.abs(position[5:] - position[:-5]))) / 5.0
    return at + 1 if step[at] > 3.0 * fastest + NOISE_RATIO * sd else None


def longest_run(values: np.ndarray) -> tuple[int, int]:
    """First index and length of the longest run of exactly equal values."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1, [values.size]])
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    return int(edges[longest]), int(lengths[longest])


def clipped_drive(values: np.ndarray, sd: float, unit: str) -> str:
    """A sentence (without subject) if samples accumulate at an end of an otherwise continuous input; else empty.

    The peak of a sine does not count: inwards its density falls by (sqrt(2) - 1), that of a clipped signal by much
    more. Steps and staircases accumulate everywhere.
    """
    span = float(np.ptp(values))
    if span <= 20.0 * sd:
        return ""
    width = max(9.0 * sd, 0.01 * span)
    count = int(np.ceil(span / width)) + 1
    parts = []
    for sign in (1.0, -1.0):
        # Distance from this end in bins of one width; noise spreads clipped samples over the first bin.
        place = np.minimum(((np.max(sign * values) - sign * values) / width).astype(int), count - 1)
        held = np.bincount(place, minlength=count)
        inner = np.sort(held[2:])[::-1]
        share = held[0] / values.size
        beside = held[1:3].mean() + np.sqrt(held[1:3].mean()) + 1.0
        continuous = inner[1:11].sum() < CONTINUOUS * max(inner[1:].sum(), 1)
        if share >= CLIPPED_SHARE and held[0] > CLIPPED_RATIO * beside and continuous and count > MIN_BINS:
            level = float(np.median(values[place == 0]))
            parts.append(f"{level:.3g} {unit} ({100 * share:.1f} % of the samples)")
    if not parts:
        return ""
    return (
        f"is clipped at {' and '.join(parts)}: the log is valid only if the plant was driven by the clipped values; "
        "record the measured drive, or reduce the input"
    )


def clipped_output(values: np.ndarray, unit: str) -> str:
    """A sentence (without subject) if an extreme repeats exactly while other values don't; else empty."""
    parts = []
    for extreme in (np.max(values), np.min(values)):
        at = values == extreme
        first, length = longest_run(np.where(at, 0.0, 1.0 + np.arange(values.size)))
        if length < REPEATS or not at[first] or at.mean() > 0.9:
            continue
        other = ~(at[1:] & at[:-1])
        repeats = float(np.mean((np.diff(values) == 0.0)[other]))
        # Expected number of runs of this length, if each value were repeated as often as the others.
        if values.size * repeats ** (length - 1) < BY_CHANCE:
            parts.append(f"{extreme:g} {unit} ({int(at.sum())} samples, up to {length} in a row)")
    if not parts:
        return ""
    return f"is clipped at {' and '.join(parts)}: its sensor or converter reached its range; leave those parts out"
