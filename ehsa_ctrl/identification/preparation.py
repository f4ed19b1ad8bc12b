"""Preparation of a log on request: resampling, zeros at rest, alignment in time, a segment. Each step is recorded."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..core.errors import InputError, choices
from ..core.log import CHANNELS, Log
from ..core.resampling import Sampled, resample_signal, sample_count
from ..plant.plant import Plant
from ..simulation.engine import simulate
from .alignment import align_channels
from .initial_state import sensor_sd
from .plant_log import SHORTEST, held_channels

#: A channel is at rest while it stays within this many standard deviations of its first samples' median.
REST_BAND = 5.0
#: Shortest rest from which a zero is taken [s].
SHORTEST_REST = 0.1


@dataclass(frozen=True)
class Step:
    """One step of a preparation: its kind, a sentence, and its figures in SI units."""

    kind: str
    words: str
    figures: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.words

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "words": self.words, **self.figures}


@dataclass(frozen=True)
class Preparation:
    """What to do to a log; the default does nothing.

    Attributes
    ----------
    from_, to: the segment to keep, s of the log's own time.
    zero: channels (pressures, force, position, speed) whose mean at rest is shifted to the plant's rest value.
    rest: (from, to) of that rest, s; by default the rest before the first motion.
    resample: new sampling rate of all channels, Hz.
    align: drives and outputs that are shifted in time by their delay against the other channels.
    sample_time: of the rows, s, instead of the time in the file.
    """

    from_: float | None = None
    to: float | None = None
    zero: tuple[str, ...] = ()
    rest: tuple[float, float] | None = None
    resample: float | None = None
    align: tuple[str, ...] = ()
    sample_time: float | None = None

    def apply(self, log: Log, plant: Plant) -> tuple[Log, tuple[Step, ...]]:
        """The prepared log and its steps: notes of reading it, then sample time, resample, zero, align, segment.

        The rest that gives the zeros may lie before the segment; delays are those of the segment.

        Raises
        ------
        InputError: a missing or unsuitable channel, no rest, a segment that is too short.
        """
        log, steps = self._retimed(log, held_channels(plant))
        if self.zero:
            log, found = zero(log, plant, self.zero, self.rest)
            steps += found
        if self.align:
            log, told = align_channels(log, plant, self.align, self.from_, self.to)
            steps += [Step("align", words, figures) for words, figures in told]
        return self._cut(log, steps)

    def apply_to_time(self, log: Log, held: Collection[str] = ()) -> tuple[Log, tuple[Step, ...]]:
        """As `apply`, but only what needs no plant: sample time, resampling and segment.

        held: channels that are constant between their samples.
        """
        return self._cut(*self._retimed(log, held))

    def _retimed(self, log: Log, held: Collection[str]) -> tuple[Log, list[Step]]:
        steps = [Step("read", note) for note in log.notes]
        if log.rates is not None:
            steps.append(Step("rates", str(log.rates), log.rates.to_dict()))
        if self.sample_time is not None:
            if not np.isclose(log.sample_time, self.sample_time, rtol=1e-9):
                log = replace(log, time=self.sample_time * np.arange(len(log)), before=None)
            words = f"the rows are {self.sample_time:g} s apart, as given"
            steps.append(Step("sample_time", words, {"sample_time": self.sample_time}))
        if self.resample is not None and (log.rates is None or log.rates.rate != self.resample):
            log, step = resample(log, self.resample, held)
            steps.append(step)
        return log, steps

    def _cut(self, log: Log, steps: list[Step]) -> tuple[Log, tuple[Step, ...]]:
        if self.from_ is not None or self.to is not None:
            log = log.segment(self.from_, self.to, shortest=SHORTEST)
            ends = {"from": float(log.time[0]), "to": float(log.time[-1]), "samples": len(log)}
            words = f"segment from {log.time[0]:g} to {log.time[-1]:g} s, {len(log)} samples"
            steps = [*steps, Step("segment", words, ends)]
        return log, tuple(steps)


def resample(log: Log, rate: float, held: Collection[str]) -> tuple[Log, Step]:
    """Resample all channels to a uniform `rate` [Hz]; this also removes jitter of the time column.

    The `held` channels, zero-order-held inputs, are averaged over the new samples, which preserves their integral.
    Others pass an anti-aliasing filter without delay, see `core/resampling.py`.

    Raises InputError for a rate that is not positive or leaves fewer than SHORTEST samples.
    """
    usual = float(np.median(np.diff(log.time)))
    count = sample_count(float(log.time[-1] - log.time[0]), rate, SHORTEST)
    time = log.time[0] + np.arange(count) / rate
    channels = {
        name: resample_signal(Sampled(log.time, values), time, rate, held=name in held)
        for name, values in log.channels.items()
    }
    before = None if log.before is None else resample(log.before, rate, held)[0]
    words = f"resampled from {1 / usual:.4g} to {rate:g} Hz, {count} samples"
    figures = {"rate": rate, "rate_before": 1 / usual, "samples": count}
    return replace(log, time=time, channels=channels, before=before), Step("resample", words, figures)


def zero(
    log: Log, plant: Plant, channels: tuple[str, ...], rest: tuple[float, float] | None = None
) -> tuple[Log, list[Step]]:
    """Shift channels so that their mean at rest is the plant's rest value: P_0, x_0, no speed, the load's force.

    Raises InputError for an input or an unknown channel, and where no rest is given or found.
    """
    targets = _rest_values(plant)
    for channel in channels:
        if channel not in targets or channel not in log.channels:
            known = [name for name in targets if name in log.channels]
            raise InputError(f"no zero of {channel!r}: the plant has no rest value or the log no such channel; "
                             f"{choices(channel, known)}")  # fmt: skip
    if rest is not None:
        piece = log.segment(*rest)
        first, last = float(piece.time[0]), float(piece.time[-1])
    else:
        first, last = find_rest(log, plant)
        piece = log.segment(first, last)
    changed, steps = dict(log.channels), []
    for channel in channels:
        mean = float(np.mean(piece[channel]))
        shift = targets[channel] - mean
        changed[channel] = log[channel] + shift
        unit = CHANNELS[channel].unit
        words = (
            f"{channel}: zero from the rest {first:g} to {last:g} s, shifted by {shift:.4g} {unit} (mean {mean:.4g}, "
            f"at rest the plant has {targets[channel]:.4g})"
        )
        figures = {"channel": channel, "shift": shift, "unit": unit, "rest": [first, last]}
        steps.append(Step("zero", words, figures))
    before = log.before
    if before is not None:
        shifts = {step.figures["channel"]: step.figures["shift"] for step in steps}
        moved = {name: values + shifts.get(name, 0.0) for name, values in before.channels.items()}
        before = replace(before, channels=moved)
    return replace(log, channels=changed, before=before), steps


def _rest_values(plant: Plant) -> dict[str, float]:
    """Value of each output channel, and of the load cell, at the plant's rest."""
    index, system = plant.structure.equations.index, plant.structure.system
    values = {channel: float(plant.rest[index(state)]) for channel, state in system.outputs.items()}
    if system.cell is not None:
        values[system.cell_channel] = float(simulate(plant, np.zeros(2)).cell_force[0])
    return values


def find_rest(log: Log, plant: Plant) -> tuple[float, float]:
    """Beginning and end [s] of the rest at the log's beginning: inputs and outputs constant within their noise.

    Raises InputError if it is shorter than SHORTEST_REST.
    """
    system = plant.structure.system
    quiet = np.ones(len(log), dtype=bool)
    for channel in (*system.drives.values(), *system.outputs):
        if channel not in log.channels:
            continue
        sd = sensor_sd(plant, log, channel)
        level = float(np.median(log[channel][: max(int(SHORTEST_REST / log.sample_time), 5)]))
        quiet &= np.abs(log[channel] - level) <= REST_BAND * sd
    moving = np.flatnonzero(~quiet)
    count = int(moving[0]) if moving.size else len(log)
    # The motion begins before it exceeds the noise.
    count -= max(count // 20, 1) if moving.size else 0
    if count * log.sample_time < SHORTEST_REST or count < 5:
        raise InputError(
            f"{log.path or 'the log'}: is not at rest for its first {SHORTEST_REST:g} s, so no zero can be taken "
            "there; give start and end of a rest (--rest S:S)"
        )
    return float(log.time[0]), float(log.time[count - 1])
