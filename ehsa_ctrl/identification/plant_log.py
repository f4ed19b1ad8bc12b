"""Reading a measured log for a plant, and what can't be determined without a missing channel."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..core.log_reader import read_log
from ..plant.plant import Plant

#: Smallest number of samples of a log: 0.1 s at 250 Hz. Engineering judgement.
SHORTEST = 25

#: What can't be determined without the channel that shows the velocity of a contact, by the contact's name.
MISSING_SPEED = {
    "shaft": "what the shaft does: motor friction and inertia can't be separated from the torque constant",
    "rod": "the rod's speed",
}
MISSING_POSITION = "where the rod is: leakage, load spring and end stops can't be distinguished"
MISSING_PRESSURE = "the pressure in chamber {}: the force on the rod can't be separated from the motor's"
MISSING_FORCE = "the force on the rod: the load can't be separated from the rod's friction"

#: Sample times, as multiples of the plant's, that are plausible in s. Between milliseconds and seconds lies a factor of
#: 1000, so that neither is mistaken for the other. Engineering judgement.
FASTEST, SLOWEST = 1.0 / 300.0, 100.0
#: Units in which time may be counted, in s.
COUNTS = {"ms": 1e-3, "us": 1e-6, "units of 100 ns": 1e-7, "ns": 1e-9}


def read_plant_log(
    path: str | Path,
    plant: Plant,
    *,
    uniform: bool = True,
    span: tuple[float | None, float | None] = (None, None),
    sample_time: float | None = None,
    rate: float | None = None,
) -> Log:
    """Read a log of this plant through the plant's [log] table.

    The channels of the plant's inputs and at least one of its outputs are required; the `missing` of the log lists the
    outputs that it lacks. A log of several rates is resampled, see `core/resampling.py`.

    span: rows outside these times [s] are ignored, with any gaps and bad values there. sample_time: of the rows [s],
    instead of the file's time. rate: of the channels of a log of several rates [Hz], by default the plant's.

    Raises
    ------
    InputError: as `read_log`; no output at all; a time column that is not in s.
    """
    system = plant.structure.system
    wanted = [*system.outputs, *([system.cell_channel] if system.cell else [])]
    drives = list(system.drives.values())
    if sample_time is not None:
        check_sample_time(sample_time)
    log = read_log(
        path, drives, columns=plant.log, shortest=SHORTEST, uniform=uniform, wanted=wanted, span=span,
        sample_time=sample_time, rate=rate or 1.0 / plant.sample_time, held=held_channels(plant),
    )  # fmt: skip
    missing = tuple(channel for channel in wanted if channel not in log.channels)
    if not any(channel in log.channels for channel in system.outputs):
        unread = "".join(f"; {note.partition(': ')[2]}" for note in log.notes if "[log]" in note)
        raise InputError(
            f"{path}: has none of the channels {', '.join(system.outputs)}, the outputs of {plant.name}; rename the "
            f"columns, or map them in the plant's [log] table{unread}"
        )
    wrong = wrong_time_unit(log, plant)
    if wrong:
        raise InputError(wrong)
    return replace(log, missing=missing)


def check_sample_time(sample_time: float) -> None:
    """Raise InputError for a sample time [s] that is not a number above 0."""
    if not (np.isfinite(sample_time) and sample_time > 0.0):
        raise InputError(f"sample time of {sample_time:g} s: must be a number greater than 0")


def held_channels(plant: Plant) -> set[str]:
    """The channels that are constant between their samples: drives behind a zero-order hold."""
    system = plant.structure.system
    return set(system.drives.values()) if system.hold == "zero_order" else set()


def plant_of_log(plant: Plant, log: Log) -> Plant:
    """The plant with the settings of this log. Raises InputError for one that is not a parameter."""
    return plant.set(**log.settings) if log.settings else plant


def column_of(plant: Plant, channel: str) -> str:
    """The column of a log that holds a channel."""
    return plant.log[channel].column if channel in plant.log else channel


def log_table_entry(plant: Plant, channel: str, scale: float = 1.0, *, source: str = "", digits: int = 7) -> str:
    """The line of the plant's [log] table that reads `channel` from the column of `source`, by default its own.

    scale multiplies the mapping of that column; a negative one inverts its offset too.
    """
    source = source or channel
    at = plant.log.get(source)
    factor, offset = (at.scale, at.offset) if at is not None else (1.0, 0.0)
    words = [f'column = "{column_of(plant, source)}"']
    if (factor, scale) != (1.0, 1.0):
        words.append(f"scale = {factor * scale:.{digits}g}")
    if offset:
        words.append(f"offset = {offset if scale > 0.0 else -offset:.{digits}g}")
    return f"{channel} = {{ {', '.join(words)} }}"


def wrong_time_unit(log: Log, plant: Plant) -> str:
    """A sentence if the time can't be in s, else empty. `wrong_sample_time` detects minutes."""
    ratio = log.sample_time / plant.sample_time
    if FASTEST <= ratio < SLOWEST:
        return ""
    mapped = plant.log["t"].scale if "t" in plant.log else 1.0
    steps = f"{log.sample_time:g} s, {ratio:.3g} times"
    if ratio < FASTEST:
        steps = f"{log.sample_time:.3g} s, 1/{1 / ratio:.3g} of"
        unit, scale = ("s already", 1.0 / mapped) if mapped < 1.0 else ("h", 3600.0)
    else:
        unit, scale = min(COUNTS.items(), key=lambda item: abs(math.log(ratio * item[1])))
    given = f"--sample-time {plant.sample_time:g}"
    if log.time_source:
        return (
            f"{log.path or 'the log'}: by {log.time_source} the sample time is {steps} that of {plant.name}; give the "
            f"sample time of the rows, as in {given}"
        )
    column = column_of(plant, "t")
    where = f"{log.path or 'the log'}: column {column!r} has steps of {steps} the sample time of {plant.name}"
    if mapped == 1.0 and abs(log.sample_time - 1.0) < 1e-9:
        return (
            f"{where}; steps of exactly 1 are row numbers, or what an exporter writes that does not know the rate: "
            f"give the sample time of the rows, as in {given}, or, if they are ms, write "
            f"{log_table_entry(plant, 't', 1e-3)} in the plant's [log] table"
        )
    return (
        f"{where}; it is probably in {unit}: write {log_table_entry(plant, 't', scale)} in the plant's [log] table, or "
        f"give the sample time of the rows, as in {given}"
    )


def missing_information(log: Log, plant: Plant) -> dict[str, str]:
    """Missing channel -> a sentence on what this log can't determine without it."""
    system = plant.structure.system
    outputs = system.outputs
    missing = dict.fromkeys([*(name for name in outputs if name not in log.channels), *log.missing])
    shown = {outputs[channel] for channel in outputs if channel in log.channels}
    words = {contact.velocity: MISSING_SPEED[contact.name] for contact in system.contacts}
    words |= {state: MISSING_PRESSURE.format(number) for number, state in enumerate(system.pressures, 1)}
    words |= dict.fromkeys(system.positions.values(), MISSING_POSITION)
    found = {}
    for channel in missing:
        state = outputs.get(channel, "")
        # A speed without a channel follows from the position.
        if system.slopes.get(state) not in shown:
            what = MISSING_FORCE if channel == system.cell_channel else words.get(state, f"what {channel} shows")
            found[channel] = f"without {channel} the log does not show {what}"
    return found
