"""A measured log as a plant needs it: its drives, what of its outputs there is, and what the rest leaves unsaid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..core.errors import InputError
from ..core.log import Log
from ..core.log_reader import read_log
from ..plant.plant import Plant

#: Fewer samples than this say nothing about a plant.
SHORTEST = 25

#: What a log without a channel can't tell, by the state that the channel shows.
UNTOLD = {
    "omega": "what the shaft does: motor friction and inertia can't be told from the torque constant",
    "P_1": "the pressure in chamber 1: what the rod feels can't be told from what the motor gives",
    "P_2": "the pressure in chamber 2: what the rod feels can't be told from what the motor gives",
    "v": "the rod's speed",
    "x": "where the rod is: leakage, load spring and end stops can't be told apart",
}
UNTOLD_FORCE = "the force on the rod: the load can't be told from the rod's friction"


def read_plant_log(
    path: str | Path,
    plant: Plant,
    *,
    shortest: int = SHORTEST,
    uniform: bool = True,
    span: tuple[float | None, float | None] = (None, None),
) -> Log:
    """Read a log of this plant through the plant's [log] table.

    The channels that drive the plant have to be there, and one of those that show what it did; the others are read
    where they are there and else named in `missing` of the log. span: rows before and after these times [s] are not
    looked at, so that a gap or a bad value there does no harm.

    Raises
    ------
    InputError: as `read_log`; no output at all; a sample time that only another unit of time explains.
    """
    system = plant.structure.system
    wanted = [*system.outputs, *(["force"] if system.cell else [])]
    drives = list(system.drives.values())
    log = read_log(path, drives, columns=plant.log, shortest=shortest, uniform=uniform, wanted=wanted, span=span)
    missing = tuple(channel for channel in wanted if channel not in log.channels)
    if not any(channel in log.channels for channel in system.outputs):
        unread = "".join(f"; {note.partition(': ')[2]}" for note in log.notes if "[log]" in note)
        raise InputError(
            f"{path}: has none of the channels {', '.join(system.outputs)} that show what {plant.name} did; name their "
            f"columns so, or map them in the plant's [log] table{unread}"
        )
    wrong = wrong_time_unit(log, plant)
    if wrong:
        raise InputError(wrong)
    return replace(log, missing=missing)


#: Nobody logs this many times as fast as a plant is sampled.
SHORT = 1.0 / 300.0


def wrong_time_unit(log: Log, plant: Plant) -> str:
    """A sentence if samples are too far apart or too close for time in s; else empty. Minutes: see `wrong_clock`."""
    ratio = log.sample_time / plant.sample_time
    at = plant.log.get("t")
    column, mapped = (at.column, at.scale) if at is not None else ("t", 1.0)
    if ratio < SHORT:
        probably = f'in s already: write t = {{ column = "{column}" }}'
        if mapped >= 1.0:
            probably = f'in h: write t = {{ column = "{column}", scale = {3600 * mapped:g} }}'
        return (
            f"{log.path or 'the log'}: column {column!r} has steps of {log.sample_time:.3g} s, 1/{1 / ratio:.3g} of "
            f"the sample time of {plant.name}; it is probably {probably} in the plant's [log] table"
        )
    if ratio < 100.0:
        return ""
    unit, scale = ("ms", 1e-3) if ratio < 1e5 else ("us", 1e-6)
    return (
        f"{log.path or 'the log'}: column {column!r} has steps of {log.sample_time:g} s, {ratio:.3g} times the sample "
        f'time of {plant.name}; it is probably in {unit}: write t = {{ column = "{column}", scale = {scale:g} }} in '
        "the plant's [log] table"
    )


def untold(log: Log, plant: Plant) -> dict[str, str]:
    """What this log can't tell, a sentence for each channel that is missing; `missing` of it, and every output."""
    outputs = plant.structure.system.outputs
    missing = dict.fromkeys([*(name for name in outputs if name not in log.channels), *log.missing])
    return {
        channel: f"without {channel} the log does not tell "
        + (UNTOLD_FORCE if channel == "force" else UNTOLD.get(outputs.get(channel, ""), f"what {channel} shows"))
        for channel in missing
        # A speed that is missing is the slope of the position.
        if outputs.get(channel) != "v" or "x" not in {outputs[c] for c in outputs if c in log.channels}
    }
