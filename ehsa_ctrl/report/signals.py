"""Signals on axes and in tables: words, and the units in which they are shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.log import CHANNELS, Log
from ..core.unit import factor
from .text import unit

#: The unit shown for an SI unit of a logged channel.
SHOWN = {"rad/s": "rpm", "Pa": "bar", "m": "mm", "m/s": "mm/s", "N": "kN"}
#: Units shown for unknown inputs and the variables that they depend on; forces stay in N.
SHOWN_OF_BALANCES = SHOWN | {"m3/s": "cm3/s", "Pa/s": "bar/s", "rad/s Pa": "rad bar/s", "N": "N", "m3": "cm3"}
#: Name of a channel on an axis, where its own is not a word.
WORDS = {"p1": "pressure P₁", "p2": "pressure P₂", "velocity": "rod speed", "drive_force": "drive force"}
#: The unknown input of each balance.
BALANCES = {
    "torque": "unknown torque", "flow_1": "unknown flow into chamber 1", "flow_2": "unknown flow into chamber 2",
    "force": "unknown force",
}  # fmt: skip
#: The part of a log that is shown in detail: longest [s], largest share of the log, fewest samples.
DETAIL, SHARE, FEWEST = 1.0, 0.25, 50


@dataclass(frozen=True)
class Signal:
    """A signal of a simulated run on an axis: what it is, its SI unit, the unit shown, the least span of the axis."""

    words: str
    unit: str
    shown: str
    least: float

    @property
    def scale(self) -> float:
        """SI units in one shown unit."""
        return factor(self.shown, self.unit)

    @property
    def label(self) -> str:
        return f"{self.words}\n({unit(self.shown)})"

    def read(self, values: np.ndarray) -> np.ndarray:
        """Values (N,) in SI units in the unit shown."""
        return np.asarray(values, dtype=float) / self.scale


SIGNALS = {
    "current": Signal("current", "A", "A", 0.1),
    "omega": Signal("speed", "rad/s", "rpm", 10.0),
    "pressures": Signal("pressures", "Pa", "bar", 0.5),
    "dP": Signal("pressure\ndifference", "Pa", "bar", 0.5),
    "v": Signal("rod speed", "m/s", "mm/s", 1.0),
    "x": Signal("position", "m", "mm", 0.1),
    "error": Signal("error", "m", "mm", 0.02),
    "force": Signal("force", "N", "kN", 0.1),
}


class Shown(NamedTuple):
    """How a logged channel is shown: its words, the unit, and the SI units in one of that."""

    words: str
    unit: str
    scale: float

    @property
    def label(self) -> str:
        return f"{self.words} ({unit(self.unit)})"

    @property
    def two_lines(self) -> str:
        return f"{self.words}\n({unit(self.unit)})"


def shown(channel: str) -> Shown:
    """How a channel is shown: in its SI unit where no other is usual."""
    own = CHANNELS[channel].unit
    usual = SHOWN.get(own, own)
    return Shown(WORDS.get(channel, channel), usual, factor(usual, own))


def signal_shown(signal: str) -> Shown:
    """How a signal that has a gap is shown."""
    return shown(signal if signal in CHANNELS else "velocity")


def unit_of_balance(si: str) -> tuple[str, float]:
    """The unit shown for an unknown input or its variable, and the SI units in one of it."""
    usual = SHOWN_OF_BALANCES.get(si, si)
    return usual, factor(usual, si) if usual != si else 1.0


def unit_of_number(si: str, value: float) -> tuple[str, float]:
    """The unit shown for a number of an effect or a sensor, and the SI units in one of it; short times are in ms."""
    if si == "s":
        return ("ms", 1e-3) if abs(value) < 0.2 else ("s", 1.0)
    return unit_of_balance(si) if si in SHOWN else (si, 1.0)


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
