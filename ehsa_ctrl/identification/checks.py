"""Checks of a log before a model is fitted to it: errors and warnings, each in a sentence with its remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS, Log
from ..core.result import as_dict
from ..core.text import join_words
from ..plant.plant import Plant
from .clock_delays import find_clocks
from .free_run_checks import wrong_sample_time, wrong_signs, wrong_units
from .initial_state import sensor_sd
from .plant_log import missing_information, plant_of_log, wrong_time_unit
from .sample_checks import clipped_drive, clipped_output, hold_length, jump, longest_run, spikes

Severity = Literal["error", "warning"]

# The thresholds are engineering judgement: loose, so that a sound log is not rejected.

#: A channel is stuck if it stays constant for this time [s] and this share of the log while others move.
STUCK_TIME, STUCK_SHARE = 0.5, 0.05
#: A noisy channel is stuck if it repeats a value for this time [s] and this many samples.
FROZEN_TIME, FROZEN_SAMPLES = 0.2, 10
#: Largest number of reversals of a plant under a constant input.
REVERSALS = 4
#: An input that varies by less than this multiple of its noise is constant.
CONSTANT = 12.0
#: Gauge pressure of vacuum [Pa].
VACUUM = -1.013e5
#: A position beyond the stroke by more than this share of it is not explained by sensor errors.
BEYOND = 0.02
#: A channel that varies by less than this multiple of its noise is too weak to identify much.
WEAK = 10.0


@dataclass(frozen=True)
class LogFinding:
    """An error in a log, or a warning.

    kind: time_unit, missing, spike, rows_missing, no_motion, dead, same, drive_constant, stuck, held, unit, late, sign,
    drive_clipped, output_clipped, stroke, vacuum, no_reversal or weak.
    channel: None for the log as a whole, or for several. sentence: what was found, with figures, and what to do.
    figures: of a late clock, see `Clock.to_dict`; SI units.
    """

    kind: str
    channel: str | None
    severity: Severity
    sentence: str
    figures: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.sentence

    def labelled(self, log: Log) -> LogFinding:
        """The same, with the log's name if it is one of several."""
        return replace(self, sentence=f"{log.name}: {self.sentence}") if log.label else self

    def to_dict(self) -> dict[str, Any]:
        """As in a result's JSON."""
        return as_dict(self, "kind channel severity sentence", **self.figures)


def check_log(log: Log, plant: Plant) -> tuple[LogFinding, ...]:
    """Check motion, sample time, dead, stuck and clipped channels, spikes, signs and units; errors first.

    Signs and units are compared with a free run of `plant` with the log's inputs, if this run moves enough. Check a log
    as it will be used, after preparation.
    """
    return tuple(sorted(_findings(log, plant_of_log(plant, log)), key=lambda finding: finding.severity != "error"))


def raise_on_error(log: Log, findings: Iterable[LogFinding]) -> None:
    """Raise InputError for the first finding that is an error."""
    for finding in findings:
        if finding.severity == "error":
            where = "" if str(log.path) in finding.sentence else f"{log.path or 'the log'}: "
            raise InputError(where + finding.sentence)


def _error(kind: str, channel: str | None, sentence: str) -> LogFinding:
    return LogFinding(kind, channel, "error", sentence)


def _warning(kind: str, channel: str | None, sentence: str) -> LogFinding:
    return LogFinding(kind, channel, "warning", sentence)


def _findings(log: Log, plant: Plant) -> Iterator[LogFinding]:
    time = wrong_time_unit(log, plant)
    if time:
        yield _error("time_unit", "t", time)
        return
    system = plant.structure.system
    outputs = [channel for channel in system.outputs if channel in log.channels]
    drives = [channel for channel in system.drives.values() if channel in log.channels]
    for channel, sentence in missing_information(log, plant).items():
        if channel in system.outputs:
            yield _warning("missing", channel, f"{sentence}; record it if there is a sensor")
    clean = dict(log.channels)
    for channel in (*drives, *outputs):
        sd = sensor_sd(plant, log, channel)
        rows, usual = spikes(log[channel], sd)
        # A pulse of an otherwise constant input is a test signal.
        if rows.size and (channel in outputs or np.ptp(usual) > 20.0 * sd):
            clean[channel] = usual
            yield _spike(log, channel, rows, usual, drives=channel in drives)
    log = replace(log, channels=clean)
    moving = [channel for channel in outputs if _moves(plant, log, channel)]
    if not moving:
        what = ", ".join(f"{name} by {np.ptp(log[name]):.3g} {CHANNELS[name].unit}" for name in outputs)
        yield _error(
            "no_motion", None,
            f"nothing moves in this log ({what}: no more than noise); increase the input, or check the mapping of the "
            "columns",
        )  # fmt: skip
        return
    # A switch, which has no unit, may stay as it is.
    measured = [channel for channel in (*drives, *outputs) if CHANNELS[channel].unit != "1"]
    dead = [channel for channel in measured if np.ptp(log[channel]) == 0.0]
    dead = [channel for channel in dead if channel in outputs or log[channel][0] == 0.0]
    for channel in dead:
        yield _error(
            "dead", channel,
            f"{channel} is {log[channel][0]:g} {CHANNELS[channel].unit} throughout while the log moves "
            f"({', '.join(moving)}): the channel is dead, or the wrong column is mapped; remove it, or map the right "
            "one",
        )  # fmt: skip
    alive = [channel for channel in outputs if channel not in dead]
    for one, other in combinations(alive, 2):
        if np.array_equal(log[one], log[other]):
            yield _error(
                "same", other, f"{one} and {other} are equal in every row: the same column was logged or mapped twice"
            )
            return
    if not dead:
        yield from _constant_drive(plant, log, drives, alive)
    sentence = wrong_sample_time(plant, log)
    if sentence:
        yield _error("time_unit", "t", sentence)
        return
    noisy = {channel for channel in alive if _noisy(plant, log, channel)}
    # Exact repeats are a fault only if the other sensors are noisy: a simulated log may have no noise.
    telling = [c for c in alive if 2 * len(noisy - {c}) >= max(len(alive) - 1, 1)]
    yield from _stuck(plant, log, alive, telling, noisy)
    held = {channel: length for channel in alive if (length := hold_length(log[channel])) > 1}
    yield from _held(log, held)
    yield from _impossible(plant, log, [channel for channel in alive if channel not in held])
    units: list[str] = []
    if not dead:
        for channel, sentence in wrong_units(plant, log):
            units.append(channel)
            yield _error("unit", channel, sentence)
        if not units:
            late = set()
            for clock in find_clocks(plant, log):
                late |= {*clock.channels}
                alone = clock.channels[0] if len(clock.channels) == 1 else None
                yield LogFinding("late", alone, "warning", str(clock), clock.to_dict())
            # A late drive moves all outputs against the simulation.
            if not late.intersection(drives):
                signs = [each for each in wrong_signs(plant, log) if each[0] not in late]
                yield from (_error("sign", channel, sentence) for channel, sentence in signs)
    for channel in drives:
        sentence = clipped_drive(log[channel], sensor_sd(plant, log, channel), CHANNELS[channel].unit)
        if sentence:
            yield _warning("drive_clipped", channel, f"{channel} {sentence}")
    for channel in telling:
        sentence = clipped_output(log[channel], CHANNELS[channel].unit)
        if sentence:
            yield _warning("output_clipped", channel, f"{channel} {sentence}")
    for channel in plant.structure.system.positions:
        if channel in log.channels and channel not in units:
            yield from _beyond_stroke(plant, log, channel)
    yield from _too_little(plant, log, [channel for channel in alive if channel in moving])


def _moves(plant: Plant, log: Log, channel: str) -> bool:
    """Whether the channel changes by more than its noise, by means over ten samples."""
    blocks = log[channel][: len(log) // 10 * 10].reshape(-1, 10).mean(axis=1)
    sd = sensor_sd(plant, log, channel) / np.sqrt(10.0)
    return bool(np.ptp(blocks) > 8.0 * sd) if np.ptp(log[channel]) > 0.0 else False


def _noisy(plant: Plant, log: Log, channel: str) -> bool:
    """Whether the second differences of every 25 samples have the size of the sensor's noise.

    The longest run of one value is left out unless the log begins with it, because the channel may be stuck there.
    """
    values = log[channel]
    first, length = longest_run(values)
    pieces = [values] if first == 0 else [values[: first + 1], values[first + length - 1 :]]
    second = np.concatenate([np.diff(piece, 2) for piece in pieces])
    blocks = second[: second.size // 25 * 25].reshape(-1, 25)
    declared = plant.sensors[channel].sd if channel in plant.sensors else 0.0
    return bool(blocks.size and np.min(np.std(blocks, axis=1)) > 0.2 * np.sqrt(6.0) * declared)


def _spike(log: Log, channel: str, rows: np.ndarray, clean: np.ndarray, *, drives: bool) -> LogFinding:
    """Spikes: an error in an input, or if they have more energy than the rest of the channel, else a warning."""
    off = log[channel] - clean
    worst = int(rows[np.argmax(np.abs(off[rows]))])
    heavy = drives or float(np.sum(off**2)) > float(np.sum((clean - np.mean(clean)) ** 2))
    unit = CHANNELS[channel].unit
    return LogFinding(
        "spike", channel, "error" if heavy else "warning",
        f"{channel} jumps to {log[channel][worst]:.4g} {unit} at {log.time[worst]:g} s and back; otherwise it is "
        f"between {np.min(clean):.4g} and {np.max(clean):.4g} {unit} (samples like this: {rows.size}): replace them by "
        "the value before, or leave that part out (from, to)",
    )  # fmt: skip


def _constant_drive(plant: Plant, log: Log, drives: list[str], outputs: list[str]) -> Iterator[LogFinding]:
    """A plant that reverses repeatedly while none of its inputs changes."""
    if any(np.ptp(log[drive]) > CONSTANT * sensor_sd(plant, log, drive) for drive in drives if np.ptp(log[drive]) > 0):
        return
    speeds = {contact.velocity for contact in plant.structure.system.contacts}
    for channel in outputs:
        state = plant.structure.system.outputs[channel]
        moves = channel in plant.structure.system.positions
        if state not in speeds and not moves:
            continue
        rate = log[channel]
        if moves:
            lag = min(max(int(round(0.05 / log.sample_time)), 1), len(log) // 4)
            rate = rate[lag:] - rate[:-lag]
        limit = max(0.25 * np.max(np.abs(rate)), CONSTANT * sensor_sd(plant, log, channel))
        reversals = int(np.sum(np.diff(np.sign(rate[np.abs(rate) > limit])) != 0.0))
        if reversals > REVERSALS:
            drive = drives[0]
            yield _error(
                "drive_constant", drive,
                f"{drive} is {np.mean(log[drive]):.4g} {CHANNELS[drive].unit} throughout while {channel} reverses "
                f"{reversals} times: the wrong column is mapped; map the one that drives {plant.name}",
            )  # fmt: skip
            return


def _stuck(plant: Plant, log: Log, channels: list[str], telling: list[str], noisy: set[str]) -> Iterator[LogFinding]:
    """Channels of `telling` that repeat one value: noisy ones for a short time, others while the rest moves.

    Several channels in the same rows are one finding, because the logger stopped.
    """
    runs: dict[tuple[int, int], list[str]] = {}
    for channel in telling:
        first, length = longest_run(log[channel])
        frozen = channel in noisy and channel in plant.sensors and first > 0
        frozen = frozen and length * log.sample_time >= FROZEN_TIME and length >= FROZEN_SAMPLES
        if frozen or _constant_while_others_move(plant, log, channel, channels, first, length):
            runs.setdefault((first, length), []).append(channel)
    for (first, length), stuck in runs.items():
        what = f"{stuck[0]} stays at {log[stuck[0]][first]:g} {CHANNELS[stuck[0]].unit}"
        if len(stuck) > 1:
            what = f"{', '.join(stuck)} repeat one row"
        yield _warning(
            "stuck", stuck[0] if len(stuck) == 1 else None,
            f"{what} from {log.time[first]:g} to {log.time[first + length - 1]:g} s, without noise and while the log "
            "moves: leave that part out (from, to)",
        )  # fmt: skip


def _constant_while_others_move(
    plant: Plant, log: Log, channel: str, channels: list[str], first: int, length: int
) -> bool:
    if length * log.sample_time < STUCK_TIME or length < STUCK_SHARE * len(log):
        return False
    piece = log.segment(log.time[first], log.time[first + length - 1])
    moving = [other for other in channels if other != channel and len(piece) >= 20 and _moves(plant, piece, other)]
    # Friction may hold the rod while the shaft still turns a little; only larger motion is inconsistent.
    return any(np.ptp(piece[other]) > 0.3 * np.ptp(log[other]) for other in moving)


def _held(log: Log, channels: Mapping[str, int]) -> Iterator[LogFinding]:
    """Channels with a new value only every so many rows."""
    for rows in sorted(set(channels.values())):
        held = [channel for channel in channels if channels[channel] == rows]
        yield _warning(
            "held", held[0] if len(held) == 1 else None,
            f"each value of {join_words(held)} is repeated in {rows} rows: sampled every "
            f"{1e3 * rows * log.sample_time:.3g} ms, and delayed by up to that; log at the full rate, or --resample "
            f"{1.0 / (rows * log.sample_time):.4g}",
        )  # fmt: skip


def _impossible(plant: Plant, log: Log, channels: list[str]) -> Iterator[LogFinding]:
    """A position that jumps between two rows, and pressures below vacuum."""
    system = plant.structure.system
    for channel in channels:
        sd = sensor_sd(plant, log, channel)
        row = jump(log[channel], sd) if channel in system.positions else None
        if row is not None:
            yield _warning(
                "rows_missing", channel,
                f"{channel} goes from {log[channel][row - 1]:.4g} to {log[channel][row]:.4g} {CHANNELS[channel].unit} "
                f"within one sample at {log.time[row]:g} s, faster than it ever moves: rows were probably lost or "
                "repeated there; use the part before or after it (from, to)",
            )  # fmt: skip
        median = float(np.median(log[channel]))
        if system.outputs[channel] in system.pressures and median < VACUUM - 10.0 * sd:
            yield _warning(
                "vacuum", channel,
                f"{channel} has a median of {median / 1e5:.4g} bar, but a gauge pressure can't be below -1.013 bar: "
                f"correct its zero at rest (--zero {channel}), or its offset or sign in the plant's [log] table",
            )  # fmt: skip


def _beyond_stroke(plant: Plant, log: Log, channel: str) -> Iterator[LogFinding]:
    """A position outside the stroke: its zero is not in the middle, or it is in another unit."""
    stroke = plant.limits.get("stroke")
    if stroke is None:
        return
    low, high, half = float(np.min(log[channel])), float(np.max(log[channel])), 0.5 * stroke.value
    if max(-low, high) > half + BEYOND * stroke.value:
        yield _warning(
            "stroke", channel,
            f"{channel} goes from {1e3 * low:.4g} to {1e3 * high:.4g} mm, but {plant.name} has {1e3 * half:.4g} mm to "
            "each side of its middle: is the zero at an end, or the unit another one? Give offset or scale in the "
            "plant's [log] table",
        )  # fmt: skip


def _too_little(plant: Plant, log: Log, moving: list[str]) -> Iterator[LogFinding]:
    """Motion in one direction only, or hardly above the noise, by the first measured speed."""
    system = plant.structure.system
    speeds = {contact.velocity for contact in system.contacts}
    channel = next((channel for channel in moving if system.outputs[channel] in speeds), None)
    if channel is None:
        return
    sd, unit = sensor_sd(plant, log, channel), CHANNELS[channel].unit
    low, high = np.min(log[channel]), np.max(log[channel])
    if min(-low, high) < max(6.0 * sd, 0.02 * max(-low, high)):
        yield _warning(
            "no_reversal", channel,
            f"{channel} is {'positive' if high > -low else 'negative'} all the time, up to {max(-low, high):.3g} "
            f"{unit}: friction in the other direction can't be determined, nor Coulomb friction separated from an "
            "offset; move it in both directions",
        )  # fmt: skip
    ratio = float(np.std(log[channel])) / sd
    if ratio < WEAK:
        yield _warning(
            "weak", channel,
            f"{channel} varies by {np.std(log[channel]):.3g} {unit}, only {ratio:.1f} times its noise: too little "
            "excitation to identify much; increase the input",
        )  # fmt: skip
