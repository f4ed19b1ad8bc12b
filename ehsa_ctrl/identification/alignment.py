"""Alignment of channels in time: each moved by its delay against the channels that stay."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from ..core.errors import InputError, choices
from ..core.log import Log
from ..core.text import join_words
from ..plant.plant import Plant
from .clock_delays import channel_delays, shift_channels
from .clocks import ChannelDelay, clocks_of
from .comparison import replay
from .plant_log import SHORTEST

#: A delay is used if its standard deviation is below so many samples, or below the delay. Engineering judgement.
UNSURE_SAMPLES = 2.0


def align_channels(
    log: Log, plant: Plant, channels: tuple[str, ...], from_: float | None = None, to: float | None = None
) -> tuple[Log, list[tuple[str, dict[str, Any]]]]:
    """Move drives and outputs to earlier times by their delays; channels that share a clock move together.

    The delays are taken between `from_` and `to` [s]; the whole channels are moved. Rows at the ends that a moved
    channel lacks are left out.

    Returns the log, and for each channel a sentence and its figures: the delay [s] (None if it is not moved), its
    standard deviation and the correlation of changes.

    Raises InputError for a channel that is neither a drive nor an output, or not in the log, and if none stays.
    """
    part = log.segment(from_, to, shortest=SHORTEST)
    run = replay(plant, part)
    drives = tuple(plant.structure.system.drives.values())
    delays = channel_delays(plant, part, run)
    for channel in channels:
        if channel not in delays:
            raise InputError(
                f"no alignment of {channel!r}: it is no drive and no output of this log; {choices(channel, delays)}"
            )
    staying = {channel: each for channel, each in delays.items() if channel not in channels and not each.why}
    if not staying:
        raise InputError("no channel is left that the others could be aligned to: name fewer channels")
    clocks = {channel: clock for clock in clocks_of(delays, drives, log.sample_time) for channel in clock.channels}
    time_of = {channel: clocks[channel].delay if channel in clocks else 0.0 for channel in delays}
    reference = Counter(time_of[channel] for channel in staying).most_common(1)[0][0]
    beside = {channel: each for channel, each in staying.items() if time_of[channel] == reference}
    moves: dict[str, float] = {}
    told: list[tuple[str, dict[str, Any]]] = []
    for channel in channels:
        found = _delay_beside(channel, delays[channel], beside, drives[0])
        if time_of[channel] != reference:
            sd = clocks[channel].sd if channel in clocks else found.sd
            found = replace(found, value=time_of[channel] - reference, sd=sd)
        why = run.stopped or found.why
        if not why and found.sd > max(UNSURE_SAMPLES * log.sample_time, abs(found.value)):
            why = f"its delay of {1e3 * found.value:.3g} ms has a standard deviation of {1e3 * found.sd:.2g} ms"
        if not why:
            moves[channel] = found.value
        words = (
            f"moved by its delay against {join_words(beside)}, {1e3 * found.value:.3g} ms "
            f"(sd {1e3 * found.sd:.2g} ms, correlation of changes {found.correlation:.3f})"
        )
        figures = {"delay": None if why else found.value, "sd": found.sd, "correlation": found.correlation}
        told.append(
            (f"{channel}: not aligned, {why}" if why else f"{channel}: {words}", {"channel": channel, **figures})
        )
    return _complete_rows(shift_channels(log, plant, moves), moves), told


def _delay_beside(channel: str, own: ChannelDelay, beside: dict[str, ChannelDelay], drive: str) -> ChannelDelay:
    """Delay of a channel against those `beside`: against the drive if it is among them, as the replay is."""
    if own.why or drive in beside:
        return own
    values = [each.value for each in beside.values()]
    if channel != drive:
        return replace(own, value=own.value - float(np.median(values)))
    spread = float(np.std(values)) if len(values) > 1 else next(iter(beside.values())).sd
    return ChannelDelay(
        -float(np.median(values)), spread, correlation=min(each.correlation for each in beside.values())
    )


def _complete_rows(log: Log, moves: dict[str, float]) -> Log:
    """The rows in which every channel has a measured value after these moves [s]."""
    ends = [int(np.ceil(abs(delay) / log.sample_time - 1e-6)) for delay in moves.values()]
    first = max((rows for rows, delay in zip(ends, moves.values(), strict=True) if delay < 0.0), default=0)
    last = len(log) - max((rows for rows, delay in zip(ends, moves.values(), strict=True) if delay > 0.0), default=0)
    return (
        log
        if (first, last) == (0, len(log))
        else replace(log.rows(first, last), before=log.before if not first else None)
    )
