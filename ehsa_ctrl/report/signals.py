"""Names and display units of signals on axes and in tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.log import CHANNELS, Log
from ..core.unit import factor
from .text import unit

#: SI unit of a logged channel -> display unit.
SHOWN = {"rad/s": "rpm", "Pa": "bar", "m": "mm", "m/s": "mm/s", "N": "kN"}
#: Display units of unknown inputs and the variables that they depend on; forces stay in N.
SHOWN_OF_BALANCES = SHOWN | {"m3/s": "cm3/s", "Pa/s": "bar/s", "rad/s Pa": "rad bar/s", "N": "N", "m3": "cm3"}
#: Channel -> name on an axis, if it differs from the channel's own.
WORDS = {"p1": "pressure P₁", "p2": "pressure P₂", "velocity": "rod speed", "drive_force": "drive force"}
#: Balance -> name of its unknown input.
BALANCES = {
    "torque": "unknown torque", "flow_1": "unknown flow into chamber 1", "flow_2": "unknown flow into chamber 2",
    "force": "unknown force",
}  # fmt: skip
#: Part of a log shown in detail: longest duration [s], largest share of the log, smallest number of samples
#: (engineering judgement).
DETAIL, SHARE, FEWEST = 1.0, 0.25, 50


@dataclass(frozen=True)
class Signal:
    """A signal of a simulated run: name, SI unit, display unit, and smallest span of its axis in display units."""

    words: str
    unit: str
    display_unit: str
    least: float

    @property
    def scale(self) -> float:
        """SI value of one display unit."""
        return factor(self.display_unit, self.unit)

    @property
    def label(self) -> str:
        return f"{self.words}\n({unit(self.display_unit)})"

    def read(self, values: np.ndarray) -> np.ndarray:
        """Convert values (N,) from SI to display units."""
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


def state_signal(name: str, si: str) -> Signal:
    """A state or input of any system by its own name, with its SI unit, in its usual unit."""
    return Signal(name, si, SHOWN_OF_BALANCES.get(si, si), 0.0)


def drive_signal(channel: str, si: str) -> Signal:
    """The drive of a system, by its channel and SI unit."""
    return SIGNALS.get(channel, Signal(channel_display(channel).words, si, si, 0.0))


class ChannelDisplay(NamedTuple):
    """Display of a logged channel: name, display unit, and SI value of that unit."""

    words: str
    unit: str
    scale: float

    @property
    def label(self) -> str:
        return f"{self.words} ({unit(self.unit)})"

    @property
    def two_lines(self) -> str:
        return f"{self.words}\n({unit(self.unit)})"


def channel_display(channel: str) -> ChannelDisplay:
    """Display of a channel; in its SI unit unless another one is usual."""
    own = CHANNELS[channel].unit
    usual = SHOWN.get(own, own)
    return ChannelDisplay(WORDS.get(channel, channel), usual, factor(usual, own))


def signal_display(signal: str) -> ChannelDisplay:
    """Display of a scored signal."""
    return channel_display(signal if signal in CHANNELS else "velocity")


def unit_of_balance(si: str) -> tuple[str, float]:
    """Display unit of an unknown input or its variable, and the SI value of that unit."""
    usual = SHOWN_OF_BALANCES.get(si, si)
    return usual, factor(usual, si) if usual != si else 1.0


def unit_of_number(si: str, value: float) -> tuple[str, float]:
    """Display unit of a parameter of an effect or a sensor, and its SI value; times below 0.2 s are in ms."""
    if si == "s":
        return ("ms", 1e-3) if abs(value) < 0.2 else ("s", 1.0)
    return unit_of_balance(si) if si in SHOWN else (si, 1.0)


def spans(time: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """Start and end [s] of the parts in which `on` (N,) is true; the last sample of a part lasts until the next one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(np.int8), [0]])))
    ends = np.append(time, time[-1])
    return [(float(time[a]), float(ends[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def most_active_part(log: Log, channel: str) -> slice:
    """Samples of the second (or a quarter of a short log) in which a channel has the largest variance."""
    samples = len(log)
    length = min(DETAIL, SHARE * samples * log.sample_time)
    width = min(max(int(round(length / log.sample_time)), FEWEST), samples)
    values = log[channel] - np.mean(log[channel])
    sums = np.cumsum(np.concatenate([[0.0], values]))
    squares = np.cumsum(np.concatenate([[0.0], values**2]))
    spread = (squares[width:] - squares[:-width]) - (sums[width:] - sums[:-width]) ** 2 / width
    first = int(np.argmax(spread))
    return slice(first, first + width)
