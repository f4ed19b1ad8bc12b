"""Clocks of a log: channels that are late together, from the delays of single channels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.text import join_words

# Engineering judgement where no figure is given.

#: A delay is certain from this multiple of its standard deviation, and from this share of a sample.
CERTAIN, LEAST_SAMPLES = 4.0, 0.5
#: Channels have one clock if their delays differ by less than so many standard deviations, this share of a sample, or
#: this share of the delay: lags of the plant that the model has wrong add to that of the clock.
DEVIATIONS, SAME_SAMPLES, SAME_SHARE = 3.0, 0.25, 0.15
#: Longest delay that wrong parameters make [s]: pressures come 15 ms late with 2 % of free air in the oil.
LONGEST_LAG = 0.08


@dataclass(frozen=True)
class ChannelDelay:
    """Delay [s] of a channel against the first drive, its standard deviation, and whether a shift explains it.

    correlation, period: see SignalDelay. why: why there is no delay, in words; empty if there is one.
    """

    value: float = 0.0
    sd: float = 0.0
    correlation: float = 1.0
    explained: bool = True
    period: float | None = None
    why: str = ""


Group = dict[str, ChannelDelay]


@dataclass(frozen=True)
class Clock:
    """Channels that are late together.

    delay, sd: s against the `others`; negative if they are early. all_drives: they are the plant's drives. period: see
    SignalDelay.
    """

    channels: tuple[str, ...]
    delay: float
    sd: float
    others: tuple[str, ...]
    all_drives: bool = False
    period: float | None = None

    def __str__(self) -> str:
        alone, late = len(self.channels) == 1, self.delay > 0.0
        lag = (
            f"{abs(self.delay):.3g} s {'late' if late else 'early'}{'' if alone else ' together'} (sd {self.sd:.1g} s)"
        )
        align, it = f"--align {','.join(self.channels)}", "it" if alone else "them"
        if self.all_drives and not late:
            cure = f"the drive has a dead time (drive_delay), or another clock recorded {it}: correct that with {align}"
        else:
            late_sensor = ", or its sensor is late (sensor_delay)" if late and alone and not self.all_drives else ""
            cure = f"another clock recorded {it}{late_sensor}: correct {it} with {align}"
        if late:
            settings = " ".join(f"--set delay.{channel}={self.delay:.3g}" for channel in self.channels)
            cure += f", or set the delay ({settings})"
        names, others = join_words(self.channels), join_words(self.others)
        sentence = f"{names} {'is' if alone else 'are'} {lag} relative to {others}; {cure}"
        if self.period is not None:
            sentence += f"; as the motion is periodic, it may also be {self.period:.3g} s more or less"
        return f"{sentence}. Otherwise fits and estimates absorb it"

    def to_dict(self) -> dict[str, Any]:
        """Figures for JSON, SI units."""
        return {"channels": list(self.channels), "delay": self.delay, "sd": self.sd, "others": list(self.others)}


def group_by_delay(delays: Mapping[str, ChannelDelay], sample_time: float) -> list[Group]:
    """The channels whose delay is known, grouped by equal delays, the earliest first."""
    groups: list[Group] = []
    last = ChannelDelay()
    for channel, delay in sorted(delays.items(), key=lambda pair: pair[1].value):
        if delay.why:
            continue
        if groups and delay.value - last.value < _tolerance(last, delay, sample_time):
            groups[-1][channel] = delay
        else:
            groups.append({channel: delay})
        last = delay
    return groups


def _tolerance(one: ChannelDelay, other: ChannelDelay, sample_time: float) -> float:
    share = SAME_SHARE * min(abs(one.value), abs(other.value)) if one.value * other.value > 0.0 else 0.0
    return max(DEVIATIONS * float(np.hypot(one.sd, other.sd)), SAME_SAMPLES * sample_time, share)


def clocks_of(delays: Mapping[str, ChannelDelay], drives: tuple[str, ...], sample_time: float) -> Iterator[Clock]:
    """The clocks that differ with certainty from that of most channels. drives: the plant's, the first at delay 0.

    A small delay that no shift explains is the plant's; a large one is left out.
    """
    own, late = Group(), []
    for group in group_by_delay(delays, sample_time):
        if drives[0] in group:
            own |= group
        elif 2 * sum(each.explained for each in group.values()) >= len(group):
            late.append(group)
        elif max(abs(each.value) for each in group.values()) < LONGEST_LAG:
            own |= {channel: replace(each, value=0.0) for channel, each in group.items()}
    most = max([own, *late], key=len)
    for group in [own, *late]:
        delay, sd = _difference(group, most)
        if group is not most and abs(delay) > max(CERTAIN * sd, LEAST_SAMPLES * sample_time):
            period = next((each.period for each in [*group.values(), *most.values()] if each.period is not None), None)
            named, others = (tuple(channel for channel in delays if channel in part) for part in (group, most))
            yield Clock(named, delay, sd, others, set(named) == set(drives), period)


def _difference(group: Group, others: Group) -> tuple[float, float]:
    """Delay between two clocks [s] by the channel of each that shows it best, and its standard deviation.

    A channel that a shift explains shows it better than others. The standard deviation includes that of the channels
    among each other.
    """
    parts = [list(group.values()), list(others.values())]
    one, other = (min(part, key=lambda each: (not each.explained, each.sd)) for part in parts)
    spread = [float(np.std([each.value for each in part])) for part in parts]
    return one.value - other.value, float(np.linalg.norm([one.sd, other.sd, *spread]))
