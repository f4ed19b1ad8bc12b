"""Channels of a log on axes: words, and the unit in which a person reads them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.log import CHANNELS, Log
from ..core.unit import factor
from .number import unit

#: The unit in which a person reads what is logged in an SI unit.
SHOWN = {"rad/s": "rpm", "Pa": "bar", "m": "mm", "m/s": "mm/s", "N": "kN"}
#: What a channel is called on an axis, where its own name is no word.
WORDS = {"p1": "pressure P₁", "p2": "pressure P₂", "velocity": "rod speed", "drive_force": "drive force"}
#: Of the part of a log that is shown in detail: its length at most [s], its share of the log, its samples at least.
DETAIL, SHARE, FEWEST = 1.0, 0.25, 50


class Shown(NamedTuple):
    """A channel's words, the unit in which it is shown, and the SI units in one of these."""

    words: str
    unit: str
    scale: float

    @property
    def label(self) -> str:
        return f"{self.words} ({unit(self.unit)})"


def shown(channel: str) -> Shown:
    """How a channel is shown: its own SI unit where no other is usual."""
    own = CHANNELS[channel].unit
    usual = SHOWN.get(own, own)
    return Shown(WORDS.get(channel, channel), usual, factor(usual, own))


def liveliest(log: Log, channel: str) -> slice:
    """Samples of the second (or the quarter of a short log) in which a channel varies most."""
    samples = len(log)
    length = min(DETAIL, SHARE * samples * log.sample_time)
    width = min(max(int(round(length / log.sample_time)), FEWEST), samples)
    values = log[channel] - np.mean(log[channel])
    sums = np.cumsum(np.concatenate([[0.0], values]))
    squares = np.cumsum(np.concatenate([[0.0], values**2]))
    spread = (squares[width:] - squares[:-width]) - (sums[width:] - sums[:-width]) ** 2 / width
    first = int(np.argmax(spread))
    return slice(first, first + width)
