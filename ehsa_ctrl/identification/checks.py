"""What may be wrong with a log, said before anybody fits a model to it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS, Log
from ..plant.plant import Plant
from .clipping import clipped_drive, clipped_output, longest_run
from .record import wrong_time_unit
from .signs import swapped
from .units import wrong_units
from .window import sensor_sd

Severity = Literal["error", "warning"]

#: A channel that stands still this long [s], and for this share of the log, while others move is stuck.
STUCK_TIME, STUCK_SHARE = 0.5, 0.05
#: A position further out than the stroke by this share of it is no question of the sensor.
BEYOND = 0.02


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong or doubtful with a log.

    kind: time_unit, dead, stuck, no_motion, unit, sign, no_reversal, drive_clipped, output_clipped, stroke or weak.
    channel: where, None for the log as a whole. sentence: what was found, with figures, and what to do.
    """

    kind: str
    channel: str | None
    severity: Severity
    sentence: str

    def __str__(self) -> str:
        return self.sentence

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "channel": self.channel, "severity": self.severity, "sentence": self.sentence}


def check_log(log: Log, plant: Plant) -> tuple[Finding, ...]:
    """Look for motion, dead and clipped channels, swapped signs and wrong units; the worst first.

    Signs and units are those of a free run of `plant` with the log's drive, which is right enough for both. They are
    left out where nothing moves or where the run does not say enough. The prepared log may differ: check what was read.
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
    noisy = {channel for channel in alive if _noisy(plant, log, channel)}
    # Values that repeat exactly say something only where the sensors are noisy; a simulated log may be without noise.
    told = [c for c in alive if 2 * len(noisy - {c}) >= max(len(alive) - 1, 1)]
    yield from _stuck(plant, log, alive, told)
    wrong: list[tuple[str, str]] = []
    if not dead:
        wrong = list(wrong_units(plant, log))
        for channel, sentence in wrong:
            yield Finding("unit", channel, "error", sentence)
        if not wrong:
            for channel, sentence in swapped(plant, log):
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
    """Noise is there in every tenth of a second: second differences of 25 samples as large as the sensor makes them."""
    second = np.diff(log[channel], 2)
    blocks = second[: second.size // 25 * 25].reshape(-1, 25)
    declared = plant.sensors[channel].sd if channel in plant.sensors else 0.0
    return bool(blocks.size and np.min(np.std(blocks, axis=1)) > 0.2 * np.sqrt(6.0) * declared)


def _stuck(plant: Plant, log: Log, channels: list[str], told: list[str]) -> Iterator[Finding]:
    """A channel of `told` that repeats one value exactly while another that moves with it does move."""
    for channel in told:
        first, length = longest_run(log[channel])
        if length * log.sample_time < STUCK_TIME or length < STUCK_SHARE * len(log):
            continue
        piece = log.segment(log.time[first], log.time[first + length - 1])
        moving = [other for other in channels if other != channel and len(piece) >= 20 and _moves(plant, piece, other)]
        # Friction may hold the rod while the shaft still turns a little: only what turns much is a contradiction.
        moving = [other for other in moving if np.ptp(piece[other]) > 0.3 * np.ptp(log[other])]
        if moving:
            yield Finding(
                "stuck", channel, "warning",
                f"{channel} stays at {log[channel][first]:g} {CHANNELS[channel].unit} from {log.time[first]:g} to "
                f"{log.time[first + length - 1]:g} s while the log moves "
                f"({', '.join(moving)}): leave that part out (from, to)",
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
