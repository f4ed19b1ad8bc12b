"""What may be wrong with a log, said before anybody fits a model to it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS, Log
from ..core.text import join_words
from ..plant.plant import Plant
from .clipping import clipped_drive, clipped_output, longest_run
from .clock import late_channels, wrong_clock
from .record import untold, wrong_time_unit
from .samples import held_over, jump, spikes
from .signs import swapped
from .units import wrong_units
from .window import sensor_sd

Severity = Literal["error", "warning"]

#: A channel that stands still this long [s], and for this share of the log, while others move is stuck.
STUCK_TIME, STUCK_SHARE = 0.5, 0.05
#: A noisy channel repeats no value this long [s].
FROZEN_TIME = 0.2
#: A plant that nothing but a constant drive moves reverses no more often than this.
REVERSALS = 4
#: Gauge pressure of vacuum [Pa].
VACUUM = -1.013e5
#: A position further out than the stroke by this share of it is no question of the sensor.
BEYOND = 0.02


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong or doubtful with a log.

    kind: time_unit, missing, spike, rows_missing, no_motion, dead, same, drive_constant, stuck, held, unit, late, sign,
    drive_clipped, output_clipped, stroke, vacuum, no_reversal or weak.
    channel: where, None for the log as a whole. sentence: what was found, with figures, and what to do.
    """

    kind: str
    channel: str | None
    severity: Severity
    sentence: str

    def __str__(self) -> str:
        return self.sentence

    def of(self, log: Log) -> Finding:
        """The same, with the log's name where it has others beside it."""
        return replace(self, sentence=f"{log.name}: {self.sentence}") if log.label else self

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "channel": self.channel, "severity": self.severity, "sentence": self.sentence}


def check_log(log: Log, plant: Plant) -> tuple[Finding, ...]:
    """Look for motion, a wrong clock, dead, stuck and clipped channels, spikes, swapped signs, wrong units; the worst
    first.

    Signs and units are those of a free run of `plant` with the log's drive, which is right enough for both. They are
    left out where nothing moves or where the run does not say enough. Check a log as it will be used, prepared.
    """
    return tuple(sorted(_findings(log, plant), key=lambda finding: finding.severity != "error"))


def refuse(log: Log, findings: Iterable[Finding]) -> None:
    """Raise InputError for the first finding that says the log is plainly wrong."""
    for finding in findings:
        if finding.severity == "error":
            where = "" if str(log.path) in finding.sentence else f"{log.path or 'the log'}: "
            raise InputError(where + finding.sentence)


def _findings(log: Log, plant: Plant) -> Iterator[Finding]:
    time = wrong_time_unit(log, plant)
    if time:
        yield Finding("time_unit", "t", "error", time)
        return
    system = plant.structure.system
    outputs = [channel for channel in system.outputs if channel in log.channels]
    drives = [channel for channel in system.drives.values() if channel in log.channels]
    for channel, sentence in untold(log, plant).items():
        if channel in system.outputs:
            yield Finding("missing", channel, "warning", f"{sentence}; log it if there is a sensor")
    clean = dict(log.channels)
    for channel in (*drives, *outputs):
        sd = sensor_sd(plant, log, channel)
        rows, usual = spikes(log[channel], sd)
        # A pulse of a drive that else rests is an experiment.
        if rows.size and (channel in outputs or np.ptp(usual) > 20.0 * sd):
            clean[channel] = usual
            yield _spike(log, channel, rows, usual, drives=channel in drives)
    log = replace(log, channels=clean)
    still = {channel for channel in outputs if not _moves(plant, log, channel)}
    if len(still) == len(outputs):
        what = ", ".join(f"{name} by {np.ptp(log[name]):.3g} {CHANNELS[name].unit}" for name in outputs)
        yield Finding(
            "no_motion", None, "error",
            f"nothing moves in this log ({what}: no more than noise); drive it harder, or check that its columns are "
            "these",
        )  # fmt: skip
        return
    dead = [channel for channel in (*drives, *outputs) if np.ptp(log[channel]) == 0.0]
    dead = [channel for channel in dead if channel in outputs or log[channel][0] == 0.0]
    for channel in dead:
        yield Finding(
            "dead", channel, "error",
            f"{channel} is {log[channel][0]:g} {CHANNELS[channel].unit} throughout while the log moves "
            f"({_others(outputs, still)}): the channel is dead or another column is meant; leave it out or map it",
        )  # fmt: skip
    alive = [channel for channel in outputs if channel not in dead]
    for one, other in combinations(alive, 2):
        if np.array_equal(log[one], log[other]):
            yield Finding(
                "same", other, "error",
                f"{one} and {other} are equal in every row: the same column was logged or mapped twice",
            )  # fmt: skip
            return
    if not dead:
        yield from _constant_drive(plant, log, drives, alive)
    sentence = wrong_clock(plant, log)
    if sentence:
        yield Finding("time_unit", "t", "error", sentence)
        return
    noisy = {channel for channel in alive if _noisy(plant, log, channel)}
    # Values that repeat exactly say something only where the sensors are noisy; a simulated log may be without noise.
    told = [c for c in alive if 2 * len(noisy - {c}) >= max(len(alive) - 1, 1)]
    yield from _stuck(plant, log, alive, told, noisy)
    held = {channel: repeats for channel in alive if (repeats := held_over(log[channel])) > 1}
    yield from _held(log, held)
    yield from _impossible(plant, log, [channel for channel in alive if channel not in held])
    wrong: list[tuple[str, str]] = []
    if not dead:
        wrong = list(wrong_units(plant, log))
        for channel, sentence in wrong:
            yield Finding("unit", channel, "error", sentence)
        if not wrong:
            late = dict(late_channels(plant, log))
            for channel, sentence in late.items():
                yield Finding("late", channel, "warning", sentence)
            for channel, sentence in swapped(plant, log):
                if channel not in late:
                    yield Finding("sign", channel, "error", sentence)
    for channel in drives:
        sentence = clipped_drive(log[channel], sensor_sd(plant, log, channel), CHANNELS[channel].unit)
        if sentence:
            yield Finding("drive_clipped", channel, "warning", f"{channel} {sentence}")
    for channel in told:
        sentence = clipped_output(log[channel], CHANNELS[channel].unit)
        if sentence:
            yield Finding("output_clipped", channel, "warning", f"{channel} {sentence}")
    if "position" not in dict(wrong):
        yield from _beyond_stroke(plant, log)
    yield from _too_little(plant, log, [channel for channel in alive if channel not in still])


def _beyond_stroke(plant: Plant, log: Log) -> Iterator[Finding]:
    """A rod that is where it can't be is counted from somewhere else than the middle."""
    stroke = plant.limits.get("stroke")
    if stroke is None or "position" not in log.channels:
        return
    low, high, half = float(np.min(log["position"])), float(np.max(log["position"])), 0.5 * stroke.value
    if max(-low, high) > half + BEYOND * stroke.value:
        yield Finding(
            "stroke", "position", "warning",
            f"position goes from {1e3 * low:.4g} to {1e3 * high:.4g} mm, and {plant.name} has {1e3 * half:.4g} mm to "
            "each side of its middle: is it counted from an end, or in another unit? Give its offset or scale in the "
            "plant's [log] table",
        )  # fmt: skip


def _moves(plant: Plant, log: Log, channel: str) -> bool:
    """The channel's changes over some samples stand out of its noise.

    Differences of means of ten samples, so that a drift of the noise's own size over a log is no motion.
    """
    blocks = log[channel][: len(log) // 10 * 10].reshape(-1, 10).mean(axis=1)
    sd = sensor_sd(plant, log, channel) / np.sqrt(10.0)
    return bool(np.ptp(blocks) > 8.0 * sd) if np.ptp(log[channel]) > 0.0 else False


def _others(outputs: list[str], still: set[str]) -> str:
    return ", ".join(channel for channel in outputs if channel not in still)


def _noisy(plant: Plant, log: Log, channel: str) -> bool:
    """Noise is there in every tenth of a second: second differences of 25 samples as large as the sensor makes them.

    The longest stretch of one value is left out where the log does not begin with it: there the channel may be stuck.
    """
    values = log[channel]
    first, length = longest_run(values)
    pieces = [values] if first == 0 else [values[: first + 1], values[first + length - 1 :]]
    second = np.concatenate([np.diff(piece, 2) for piece in pieces])
    blocks = second[: second.size // 25 * 25].reshape(-1, 25)
    declared = plant.sensors[channel].sd if channel in plant.sensors else 0.0
    return bool(blocks.size and np.min(np.std(blocks, axis=1)) > 0.2 * np.sqrt(6.0) * declared)


def _stuck(plant: Plant, log: Log, channels: list[str], told: list[str], noisy: set[str]) -> Iterator[Finding]:
    """Channels of `told` that repeat one value exactly: noisy ones for no time at all, others not while the rest moves.

    Several that do so in the same rows are one finding: the logger stopped.
    """
    stretches: dict[tuple[int, int], list[str]] = {}
    for channel in told:
        first, length = longest_run(log[channel])
        sure = channel in noisy and channel in plant.sensors and first > 0
        frozen = sure and length * log.sample_time >= FROZEN_TIME and length >= 10
        if frozen or _stands(plant, log, channel, channels, first, length):
            stretches.setdefault((first, length), []).append(channel)
    for (first, length), stuck in stretches.items():
        what = f"{stuck[0]} stays at {log[stuck[0]][first]:g} {CHANNELS[stuck[0]].unit}"
        if len(stuck) > 1:
            what = f"{', '.join(stuck)} repeat one row"
        yield Finding(
            "stuck", stuck[0] if len(stuck) == 1 else None, "warning",
            f"{what} from {log.time[first]:g} to {log.time[first + length - 1]:g} s, without noise and while the log "
            "moves: leave that part out (from, to)",
        )  # fmt: skip


def _stands(plant: Plant, log: Log, channel: str, channels: list[str], first: int, length: int) -> bool:
    """Whether others move plainly while a channel stands still for that long."""
    if length * log.sample_time < STUCK_TIME or length < STUCK_SHARE * len(log):
        return False
    piece = log.segment(log.time[first], log.time[first + length - 1])
    moving = [other for other in channels if other != channel and len(piece) >= 20 and _moves(plant, piece, other)]
    # Friction may hold the rod while the shaft still turns a little: only what turns much is a contradiction.
    return any(np.ptp(piece[other]) > 0.3 * np.ptp(log[other]) for other in moving)


def _spike(log: Log, channel: str, rows: np.ndarray, clean: np.ndarray, *, drives: bool) -> Finding:
    """Samples that stand out alone; an error where they drive the plant or weigh more than all else of the channel."""
    off = log[channel] - clean
    worst = int(rows[np.argmax(np.abs(off[rows]))])
    heavy = drives or float(np.sum(off**2)) > float(np.sum((clean - np.mean(clean)) ** 2))
    unit = CHANNELS[channel].unit
    return Finding(
        "spike", channel, "error" if heavy else "warning",
        f"{channel} jumps to {log[channel][worst]:.4g} {unit} at {log.time[worst]:g} s and back, where else it goes "
        f"from {np.min(clean):.4g} to {np.max(clean):.4g} {unit} (samples like this: {rows.size}): put the value "
        "before it there, or leave that part out (from, to)",
    )  # fmt: skip


def _constant_drive(plant: Plant, log: Log, drives: list[str], outputs: list[str]) -> Iterator[Finding]:
    """A plant that goes back and forth under a drive that does not change, and nothing else drives it."""
    if any(np.ptp(log[drive]) > 12.0 * sensor_sd(plant, log, drive) for drive in drives if np.ptp(log[drive]) > 0.0):
        return
    velocities = {contact.velocity for contact in plant.structure.system.contacts}
    for channel in outputs:
        state = plant.structure.system.outputs[channel]
        if state not in {*velocities, "x"}:
            continue
        rate = log[channel]
        if state == "x":
            lag = min(max(int(round(0.05 / log.sample_time)), 1), len(log) // 4)
            rate = rate[lag:] - rate[:-lag]
        plain = rate[np.abs(rate) > max(0.25 * np.max(np.abs(rate)), 12.0 * sensor_sd(plant, log, channel))]
        turns = int(np.sum(np.diff(np.sign(plain)) != 0.0))
        if turns > REVERSALS:
            drive = drives[0]
            yield Finding(
                "drive_constant", drive, "error",
                f"{drive} is {np.mean(log[drive]):.4g} {CHANNELS[drive].unit} throughout while {channel} turns round "
                f"{turns} times: another column is meant; map the one that drives {plant.name}",
            )  # fmt: skip
            return


def _held(log: Log, channels: Mapping[str, int]) -> Iterator[Finding]:
    """Channels that have a new value in every so many rows alone."""
    for rows in sorted(set(channels.values())):
        held = [channel for channel in channels if channels[channel] == rows]
        yield Finding(
            "held", held[0] if len(held) == 1 else None, "warning",
            f"each value of {join_words(held)} stands in {rows} rows: sampled every "
            f"{1e3 * rows * log.sample_time:.3g} ms, and up to that late; log at the full rate, or --resample "
            f"{1.0 / (rows * log.sample_time):.4g}",
        )  # fmt: skip


def _impossible(plant: Plant, log: Log, channels: list[str]) -> Iterator[Finding]:
    """A position that is elsewhere from one row to the next, pressures below vacuum."""
    outputs = plant.structure.system.outputs
    for channel in channels:
        row = jump(log[channel], sensor_sd(plant, log, channel)) if outputs[channel] == "x" else None
        if row is not None:
            yield Finding(
                "rows_missing", channel, "warning",
                f"{channel} goes from {log[channel][row - 1]:.4g} to {log[channel][row]:.4g} {CHANNELS[channel].unit} "
                f"within one sample at {log.time[row]:g} s, faster than it ever moves: did rows get lost or repeated "
                "there? Use one side alone (from, to)",
            )  # fmt: skip
        low = float(np.median(log[channel]))
        if outputs[channel] in ("P_1", "P_2") and low < VACUUM - 10.0 * sensor_sd(plant, log, channel):
            yield Finding(
                "vacuum", channel, "warning",
                f"{channel} is {low / 1e5:.4g} bar by median, and a gauge pressure can't be below -1.013 bar: set its "
                f"zero by a rest (--zero {channel}), or its offset or sign in the plant's [log] table",
            )  # fmt: skip


def _too_little(plant: Plant, log: Log, moving: list[str]) -> Iterator[Finding]:
    system = plant.structure.system
    speeds = [channel for channel in moving if system.outputs[channel] in {c.velocity for c in system.contacts}]
    for channel in speeds:
        sd = sensor_sd(plant, log, channel)
        low, high = np.min(log[channel]), np.max(log[channel])
        if min(-low, high) < max(6.0 * sd, 0.02 * max(-low, high)):
            way = "positive" if high > -low else "negative"
            yield Finding(
                "no_reversal", channel, "warning",
                f"{channel} is {way} all the time, up to {max(-low, high):.3g} {CHANNELS[channel].unit}: friction of "
                "the other direction, and Coulomb friction apart from an offset, can't be told; let it move both ways",
            )  # fmt: skip
        ratio = float(np.std(log[channel])) / sd
        if ratio < 10.0:
            yield Finding(
                "weak", channel, "warning",
                f"{channel} varies by {np.std(log[channel]):.3g} {CHANNELS[channel].unit}, only {ratio:.1f} times its "
                "noise: too little excitation to identify much; drive it harder",
            )  # fmt: skip
        break
