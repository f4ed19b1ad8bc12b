"""Delays between the channels of a log.

Outputs are compared with the replay, so that lags of the plant itself cancel; channels that are proportional to each
other whatever the load are compared directly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ..core.log import Log
from ..plant.plant import Plant
from .clocks import LEAST_SAMPLES, ChannelDelay, Clock, clocks_of, group_by_delay
from .comparison import Comparison, replay
from .logged_inputs import lag_current
from .signal_delay import GAP_TIME, SignalDelay, estimate_delay

#: Delays [s] and the largest gap that a shift by them may leave. Wrong parameters make pressures and position late by
#: up to 15 ms, but a shift then leaves a third of their gap or more; where there is nothing but a delay, it leaves less
#: than a tenth (117 simulated logs with 44 effects). Only clocks make long delays, whatever gap is left beside.
DELAYS, LARGEST_GAPS = (0.01, 0.02, 0.06), (0.2, 0.3, 0.6)
#: The same for the phases of proportional channels, between which no parameter makes a delay. Engineering judgement.
PROPORTIONAL_GAP = 0.3
#: Longest delay [s] that the lag of a drive may be taken for, and time constants that are tried, over the delay.
LONGEST_DRIVE_LAG, LAGS = 0.1, (0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)


def find_clocks(plant: Plant, log: Log) -> tuple[Clock, ...]:
    """The clocks that differ from that of most channels; empty where there is one clock, or the log can't tell.

    Raises InputError as `replay`.
    """
    run = replay(plant, log)
    if run.stopped:
        return ()
    drives = tuple(plant.structure.system.drives.values())
    clocks = clocks_of(channel_delays(plant, log, run), drives, log.sample_time)
    return tuple(clock for clock in clocks if not (clock.all_drives and _drive_lags(plant, log, clock)))


def channel_delays(plant: Plant, log: Log, run: Comparison) -> dict[str, ChannelDelay]:
    """Channel -> its delay against the first drive, for drives, outputs and channels proportional to a drive.

    run: the replay of this log.
    """
    first, *others = plant.structure.system.drives.values()
    delays = {first: ChannelDelay()} | _output_delays(run)
    for drive in others:
        delays = _place_drive(plant, log, drive, delays)
    return delays


def _output_delays(run: Comparison) -> dict[str, ChannelDelay]:
    """Delay of each output against the replay."""
    dt = run.log.sample_time
    return {} if run.stopped else {c: _judge(estimate_delay(run.log[c], run.simulated[c], dt)) for c in run.fit_percent}


def _judge(found: SignalDelay) -> ChannelDelay:
    """Whether a shift explains the difference of an output and the replay."""
    explained = found.gap < float(np.interp(abs(found.value), DELAYS, LARGEST_GAPS))
    return _channel_delay(found, explained)


def _channel_delay(found: SignalDelay, explained: bool) -> ChannelDelay:
    return ChannelDelay(found.value, found.sd, found.correlation, explained and not found.why, found.period, found.why)


def _place_drive(plant: Plant, log: Log, drive: str, delays: dict[str, ChannelDelay]) -> dict[str, ChannelDelay]:
    """The delays, with a further drive on the clock that leaves the fewest clocks.

    Outputs that are not proportional to this drive are compared with a replay in which it is on time. Where two of its
    clocks leave as few, they decide by their agreement with this replay.
    """
    linked = dict(_linked_delays(plant, log, drive))
    free = {channel: each for channel, each in delays.items() if channel not in linked}
    # Shift of the drive -> its standard deviation.
    least = LEAST_SAMPLES * log.sample_time
    shifts = {0.0: 0.0} | {
        -each.value: each.sd for each in linked.values() if each.explained and abs(each.value) > least
    }

    def placed(shift: float) -> dict[str, ChannelDelay]:
        # The delay of the channel that gives the shift cancels.
        moved = {
            channel: replace(
                each,
                value=each.value + shift,
                sd=each.sd if -each.value == shift else float(np.hypot(each.sd, shifts[shift])),
            )
            for channel, each in linked.items()
        }
        again = free
        if shift:
            found = _output_delays(replay(plant, shift_channels(log, plant, {drive: shift})))
            again = free | {channel: each for channel, each in found.items() if channel in free}
        return {**again, drive: ChannelDelay(shift, shifts[shift]), **moved}

    candidates = {shift: placed(shift) for shift in shifts}

    def disorder(shift: float) -> tuple[int, float, float]:
        found = candidates[shift]
        agreement = sum(found[channel].correlation for channel in free)
        return len(group_by_delay(found, log.sample_time)), -round(agreement, 2), abs(shift)

    return candidates[min(candidates, key=disorder)]


def _linked_delays(plant: Plant, log: Log, drive: str) -> Iterator[tuple[str, ChannelDelay]]:
    """Delay of each measured channel that is proportional to a drive, or to its integral."""
    system, dt = plant.structure.system, log.sample_time
    driven = log[drive]
    alike = {channel: driven for channel, other in system.proportional if other == drive}
    for contact in system.prescribed:
        if contact.position_channel and system.drives.get(contact.velocity) == drive:
            travel = 0.5 * dt * np.cumsum(driven[1:] + driven[:-1])
            alike[contact.position_channel] = np.concatenate([[0.0], travel])
    for channel, reference in alike.items():
        if channel in log.channels:
            size = float(np.std(log[channel])) / (float(np.std(reference)) or 1.0)
            found = estimate_delay(log[channel], size * reference, dt)
            declared = [plant.sensors[name].delay if name in plant.sensors else 0.0 for name in (channel, drive)]
            found = replace(found, value=found.value - declared[0] + declared[1])
            explained = found.phase_gap < PROPORTIONAL_GAP or abs(found.value) < dt
            yield channel, _channel_delay(found, explained)


def _drive_lags(plant: Plant, log: Log, clock: Clock) -> bool:
    """Whether a first-order lag of the first drive explains the other channels as well as this early clock does."""
    delay, drive, dt = -clock.delay, plant.structure.system.drive, log.sample_time
    if not 0.0 < delay < LONGEST_DRIVE_LAG:
        return False

    def misfit(values: np.ndarray) -> float:
        run = replay(plant, replace(log, channels={**log.channels, drive: values}))
        return _misfit(run, clock.others)

    delayed = misfit(shift_channels(log, plant, {drive: -delay})[drive])
    return any(misfit(lag_current(log[drive], ratio * delay / dt)) < delayed for ratio in LAGS)


def _misfit(run: Comparison, channels: tuple[str, ...]) -> float:
    """Sum of the logarithms of what is left of the channels' changes over 20 ms; infinite for a run that stopped."""
    if run.stopped:
        return float("inf")
    width = max(int(round(GAP_TIME / run.log.sample_time)), 1)
    left = [run.residual(channel) for channel in run.fit_percent if channel in channels]
    return float(sum(np.log(max(float(np.std(each[width:] - each[:-width])), 1e-300)) for each in left))


def shift_channels(log: Log, plant: Plant, delays: Mapping[str, float]) -> Log:
    """The log with channels moved to earlier times by their delays [s], constant beyond its ends.

    A zero-order-held drive becomes its mean over each sample; other channels are interpolated by cubics.
    """
    system = plant.structure.system
    held = set(system.drives.values()) if system.hold == "zero_order" else set()
    moved = dict(log.channels)
    for channel, delay in delays.items():
        at = np.clip(log.time + delay, log.time[0], log.time[-1])
        values = log[channel]
        moved[channel] = np.interp(at, log.time, values) if channel in held else CubicSpline(log.time, values)(at)
    return replace(log, channels=moved)
