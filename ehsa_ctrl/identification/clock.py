"""Time against motion: a time column in another unit or at another rate, and channels that come late."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..core.errors import SimulationError
from ..core.log import Log
from ..plant.plant import Plant
from .preparation import LONGEST_DELAY, WEAKEST, delay_of
from .replay import replay
from .start import drive
from .units import gear

#: Agreement of rates with a free run from which on a sample time is believed, and by how much another is better: with
#: nothing beside it, and where the rod's travel says the same.
PLAUSIBLE, BETTER, SURE = 0.5, 0.25, 0.1
#: Units of time, in s, that are tried.
UNITS = {60.0: "minutes", 1e-3: "ms"}
#: A sample time is tried within this factor of the plant's.
FARTHEST = 50.0
#: Delay against the replay from which on a channel is late [s], how far it is looked for, and by how much the
#: correlation of rates has to be higher there.
LATE, LONGEST, HIGHER = 0.03, 1.0, 0.1


def wrong_clock(plant: Plant, log: Log) -> str:
    """A sentence if the log moves as the plant does at another sample time than its time column says; else empty.

    Tried are other units, the plant's own sample time, and the one at which the rod travels as far as the pump
    delivers. Where both speed and position are there, that travel has to say the same.
    """
    ratio = plant.sample_time / log.sample_time
    scales = [*UNITS, ratio]
    pumped = gear(plant, log)
    if pumped:
        # Another displacement or area turns it too, and two per cent of free air at 8 bar take up half of what the pump
        # delivers: only what no effect does is a clock's.
        travel = [] if 0.3 < pumped < 3.5 else [pumped]
        scales = [scale for scale in scales if 0.8 < scale / pumped < 1.25] or travel
    scales = [scale for scale in scales if 1.0 / FARTHEST < scale / ratio < FARTHEST and not 0.9 < scale < 1.1]
    at_hand = _agreement(plant, log, 1.0)
    if not scales or (not pumped and at_hand > PLAUSIBLE):
        return ""
    agreements = {scale: _agreement(plant, log, scale) for scale in scales}
    best = max(agreements, key=lambda scale: agreements[scale])
    if agreements[best] < max(PLAUSIBLE, at_hand + (SURE if pumped else BETTER)):
        return ""
    at = plant.log.get("t")
    column, mapped = (at.column, at.scale) if at is not None else ("t", 1.0)
    probably = f"it is probably in {UNITS[best]}" if best in UNITS else "the logger's rate is probably another one"
    return (
        f"column {column!r} has steps of {1e3 * log.sample_time:.3g} ms, and {plant.name} moves as in this log if they "
        f"are {1e3 * best * log.sample_time:.3g} ms: {probably}; write t = {{ column = \"{column}\", scale = "
        f"{mapped * best:.4g} }} in the plant's [log] table"
    )  # fmt: skip


def _agreement(plant: Plant, log: Log, scale: float) -> float:
    """How well the outputs' rates follow a free run if samples are `scale` times as far apart: 1 exactly, 0 not."""
    scaled = Log(scale * log.time, log.channels)
    try:
        run = drive(plant, scaled, None)
    except SimulationError:
        return 0.0
    if run.stopped:
        return 0.0
    agreements = []
    for channel, state in plant.structure.system.outputs.items():
        if channel not in log.channels:
            continue
        measured, simulated = log[channel], run[state]
        if state == "x":
            lag = min(max(int(round(0.02 / scaled.sample_time)), 1), len(log) // 4)
            measured, simulated = measured[lag:] - measured[:-lag], simulated[lag:] - simulated[:-lag]
        spread, left = np.std(measured), np.std(measured - simulated)
        agreements.append(1.0 - float(left / spread) if spread > 0.0 else 0.0)
    return float(np.median(agreements))


def late_channels(plant: Plant, log: Log) -> Iterator[tuple[str, str]]:
    """(channel, sentence) for each output that follows the replay much better some time earlier or later.

    Where all of them are shifted alike, it is the drive that is.
    """
    run = replay(plant, log)
    if run.stopped:
        return
    shifts = {}
    for channel in run.fit_percent:
        measured, simulated = log[channel], run.simulated[channel]
        delay, strength = delay_of(measured, simulated, log.sample_time, longest=LONGEST)
        rates = np.diff(measured), np.diff(simulated)
        there = float(np.corrcoef(*rates)[0, 1]) if min(map(np.std, rates)) > 0.0 else 1.0
        if abs(delay) > LATE and strength > max(WEAKEST, abs(there) + HIGHER):
            shifts[channel] = delay
    if len(shifts) == len(run.fit_percent) > 1 and np.ptp(list(shifts.values())) < LATE:
        (name, *_), shift = plant.structure.system.drives.values(), -float(np.mean(list(shifts.values())))
        cure = f", or say --set delay.{name}={shift:.3g}" if shift > 0.0 else ""
        yield name, _shifted(name, shift) + f"bring it to the clock of the others{cure}"
        return
    for channel, shift in shifts.items():
        cure = f"--align {channel}" if abs(shift) < LONGEST_DELAY else "a shift of that column in the file"
        yield channel, _shifted(channel, shift) + f"where its clock is the reason, put it right with {cure}"


def _shifted(channel: str, delay: float) -> str:
    return f"{channel} comes {abs(delay):.3g} s {'later' if delay > 0.0 else 'earlier'} than the other channels say: "
