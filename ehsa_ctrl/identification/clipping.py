"""Signals that were cut off: a drive by its amplifier, a channel by its sensor's range."""

from __future__ import annotations

import numpy as np

#: Share of the samples at one end from which a drive counts as clipped, and how many times as many as beside it.
CLIPPED_SHARE, CLIPPED_RATIO = 0.01, 5.0
#: A continuous signal has at most this share in its ten fullest places beside the fullest.
CONTINUOUS = 0.5
#: Exact repeats in a row from which an output may be clipped.
REPEATS = 5


def clipped_drive(values: np.ndarray, sd: float, unit: str) -> str:
    """A sentence (without subject) if samples pile up at an end of a drive that is else continuous; else empty.

    The amplitude of a sine is no pile: going inwards its density falls by (sqrt(2) - 1), a cut-off one's by much more.
    Steps and staircases have piles everywhere.
    """
    span = float(np.ptp(values))
    if span <= 20.0 * sd:
        return ""
    width = max(9.0 * sd, 0.01 * span)
    count = int(np.ceil(span / width)) + 1
    parts = []
    for sign in (1.0, -1.0):
        # Distance from this end, in places of one width: noise spreads a pile at the end over one of them.
        place = np.minimum(((np.max(sign * values) - sign * values) / width).astype(int), count - 1)
        held = np.bincount(place, minlength=count)
        inner = np.sort(held[2:])[::-1]
        share = held[0] / values.size
        beside = held[1:3].mean() + np.sqrt(held[1:3].mean()) + 1.0
        continuous = inner[1:11].sum() < CONTINUOUS * max(inner[1:].sum(), 1)
        if share >= CLIPPED_SHARE and held[0] > CLIPPED_RATIO * beside and continuous and count > 20:
            level = float(np.median(values[place == 0]))
            parts.append(f"{level:.3g} {unit} ({100 * share:.1f} % of the samples)")
    if not parts:
        return ""
    return (
        f"is clipped at {' and '.join(parts)}: what acts there is right only if the log holds the clipped values; log "
        "the measured drive, or drive it less hard"
    )


def clipped_output(values: np.ndarray, unit: str) -> str:
    """A sentence (without subject) if an end of a channel repeats exactly where its other values don't; else empty."""
    parts = []
    for extreme in (np.max(values), np.min(values)):
        at = values == extreme
        first, length = longest_run(np.where(at, 0.0, 1.0 + np.arange(values.size)))
        if length < REPEATS or not at[first] or at.mean() > 0.9:
            continue
        other = ~(at[1:] & at[:-1])
        repeats = float(np.mean((np.diff(values) == 0.0)[other]))
        # How many runs of this length chance would bring, were each value repeated as often as elsewhere.
        if values.size * repeats ** (length - 1) < 0.01:
            parts.append(f"{extreme:g} {unit} ({int(at.sum())} samples, up to {length} in a row)")
    if not parts:
        return ""
    return f"is cut off at {' and '.join(parts)}: its sensor or converter has no more range; leave those parts out"


def longest_run(values: np.ndarray) -> tuple[int, int]:
    """First index and length of the longest run of exactly equal values."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1, [values.size]])
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    return int(edges[longest]), int(lengths[longest])
