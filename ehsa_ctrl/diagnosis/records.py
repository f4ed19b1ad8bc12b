"""Records of one rig: each log with the model that is compared with it, and the samples of it that are scored.

All fits and scores are computed over a segment, which is one record or several: causes and nominal parameters are
shared, the initial state is each record's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from ..core.log import Log
from ..physics.effects import EFFECTS
from .hypothesis_model import HypothesisModel, Setting
from .signals import gap, moving_signals, scored_signals, signal_noise

#: Angles of a turn from which a run-in is tried; waves have at most twelve periods a turn. Engineering judgement.
ANGLES = 64

#: Channel -> sensor reading (N,) of each record.
Runs = tuple[Mapping[str, np.ndarray], ...]


@dataclass(frozen=True)
class Record:
    """One log in a segment.

    model: runs over the log. noise: channel -> standard deviation. parts: samples that are scored, in order; a run-in
    before them and gaps between them are simulated only.
    """

    model: HypothesisModel
    noise: Mapping[str, float]
    parts: tuple[slice, ...] = (slice(0, None),)

    @property
    def first(self) -> int:
        """First sample that is scored."""
        return int(self.parts[0].start)

    @property
    def lengths(self) -> list[int]:
        """Number of samples of each part."""
        return [len(range(*part.indices(len(self.model.log)))) for part in self.parts]

    def take(self, values: np.ndarray) -> np.ndarray:
        """The scored samples of values (N,)."""
        pieces = [values[part] for part in self.parts]
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)

    @property
    def scored_log(self) -> Log:
        """The log without the samples that are not scored."""
        log = self.model.log
        if self.lengths == [len(log)]:
            return log
        rows = self.take(np.arange(len(log)))
        return replace(
            log,
            time=log.time[0] + log.sample_time * np.arange(rows.size),
            channels={name: values[rows] for name, values in log.channels.items()},
            before=None,
        )

    def simulate(self, values: Setting) -> Mapping[str, np.ndarray] | None:
        """Channel -> sensor reading (N,) over the log; None if the run stopped.

        Rod position and mean pressure integrate, so that an error of their initial values does not decay. Their mean
        error over the run-in corrects the initial values. The angle of a law's wave is the one with which the run-in is
        simulated best.
        """
        return self.with_corrected_start(values, self.model.run([values])[0])

    def with_corrected_start(
        self, values: Setting, found: Mapping[str, np.ndarray] | None
    ) -> Mapping[str, np.ndarray] | None:
        """The run of `simulate` from the one that starts at the estimated state."""
        model = self.model
        if found is None or self.first == 0 or model.start is None:
            return found
        error = {c: float(np.mean(model.log[c][: self.first] - found[c][: self.first])) for c in found}
        start = dict(model.start)
        system = model.plant.structure.system
        shift = {state: error[channel] for channel, state in system.outputs.items() if channel in error}
        integrated = {system.outputs[one.channel] for one in system.scored if one.span}
        for state in integrated & set(shift):
            start[state] += shift[state]
        if system.pressures and set(system.pressures) <= set(shift):
            level = 0.5 * sum(shift[state] for state in system.pressures)
            start |= {state: start[state] + level for state in system.pressures}
        for name in self._angles:
            start[name] = self._angle_of_run_in(name, start, values)
        return model.run([values], start)[0] or found

    def _angle_of_run_in(self, name: str, start: Mapping[str, float], values: Setting) -> float:
        """The first value of an angle with which the run-in is simulated best.

        The integral of a measured speed over the log before it drifts by more than a period.
        """
        model = replace(self.model, log=self.model.log.rows(0, self.first))
        run_in = replace(self, model=model, parts=(slice(0, None),))

        def error(angle: float) -> float:
            (run,) = model.run([values], {**start, name: angle})
            return np.inf if run is None else run_in.change(model.log.channels, run)["total"]

        step = 2.0 * np.pi / ANGLES
        angles = start.get(name, 0.0) + step * np.arange(ANGLES)
        best = float(min(angles, key=error))
        return float(minimize_scalar(error, bounds=(best - step, best + step), method="bounded").x)

    @cached_property
    def _angles(self) -> tuple[str, ...]:
        """Angles of laws: states that integrate a measured speed."""
        plant = self.model.plant
        channels = {state: channel for channel, state in plant.structure.system.outputs.items()}
        laws = [law.definition for name in plant.structure.effects if (law := EFFECTS[name].law) is not None]
        rates = {name: one.rate for law in laws for name, one in law.states.items() if one.unit == "rad"}
        return tuple(n for n, rate in rates.items() if channels.get(rate) in self.model.channels)

    def signals(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Name -> scored signal over the scored samples, from channels."""
        log = self.model.log
        found = scored_signals(self.model.plant.structure.system.scored, channels, log.sample_time)
        return {name: self.take(values) for name, values in found.items()}

    def scored(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """As `signals`, without those of `unmoved`."""
        return {name: values for name, values in self.signals(channels).items() if name not in self.unmoved}

    @property
    def measured(self) -> dict[str, np.ndarray]:
        """Name -> measured signal over the scored samples."""
        return self.scored({channel: self.model.log[channel] for channel in self.model.channels})

    @cached_property
    def unmoved(self) -> frozenset[str]:
        """Signals that move by no more than their noise over the scored samples: they have no gap."""
        plant, log = self.model.plant, self.model.log
        declared = {channel: sensor.sd for channel, sensor in plant.sensors.items()}
        noise, stated = (
            signal_noise(plant.structure.system.scored, sd, log.sample_time) for sd in (self.noise, declared)
        )
        signals = self.signals({channel: log[channel] for channel in self.model.channels})
        return frozenset(signals) - moving_signals(signals, noise, stated)

    def gap(self, simulated: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Gap of each scored signal and in total, of a run."""
        of_system = self.model.plant.structure.system.scored
        noise = signal_noise(of_system, self.noise, self.model.log.sample_time)
        return gap(self.measured, self.scored(simulated), noise)

    def change(self, run: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> dict[str, float]:
        """By how much each signal and the total differ between two runs, as a gap."""
        signals = self.scored(run)
        return gap(signals, self.scored(other), dict.fromkeys(signals, 0.0))


@dataclass(frozen=True)
class Segment:
    """Data on which models are fitted or scored: one record or several of the same rig.

    name: for results.
    """

    records: tuple[Record, ...]
    name: str

    @property
    def model(self) -> HypothesisModel:
        """The model of the first record: plant, channels and sample time are those of all."""
        return self.records[0].model

    @property
    def paths(self) -> str:
        """The files, for messages."""
        return ", ".join(str(record.model.log.path) for record in self.records if record.model.log.path) or "the log"

    @cached_property
    def own_parameters(self) -> frozenset[str]:
        """Parameters that differ between the records, because they are set for single logs: they are not estimated."""
        first, *others = (record.model.plant.values for record in self.records)
        return frozenset(name for other in others for name, value in other.items() if value != first[name])

    @property
    def samples(self) -> int:
        """Number of residuals of a channel: every second scored sample."""
        return sum(length // 2 for record in self.records for length in record.lengths)

    @property
    def unmoved(self) -> frozenset[str]:
        """Signals that stand still in all records."""
        return frozenset.intersection(*(record.unmoved for record in self.records))

    @property
    def spread(self) -> dict[str, float]:
        """Scored signal -> standard deviation, RMS over the records."""
        return mean_square_root([{n: float(np.std(v)) for n, v in r.measured.items()} for r in self.records])

    def run(self, settings: Sequence[Setting]) -> list[Runs | None]:
        """Simulate each setting on each record; None if a run stopped."""
        return run_records(self.records, settings)

    def simulate(self, values: Setting) -> Runs | None:
        """Simulate a setting on each record, see `Record.simulate`; None if a run stopped."""
        return self.with_corrected_start(values, self.run([values])[0])

    def with_corrected_start(self, values: Setting, runs: Runs | None) -> Runs | None:
        """The runs of `simulate` from those that start at the estimated states."""
        if runs is None:
            return None
        pairs = zip(self.records, runs, strict=True)
        found = tuple(run for record, one in pairs if (run := record.with_corrected_start(values, one)) is not None)
        return found if len(found) == len(runs) else None

    def gap(self, values: Setting) -> dict[str, float]:
        """Gap of each scored signal and in total."""
        return self.gap_of(self.simulate(values))

    def gap_of(self, runs: Runs | None) -> dict[str, float]:
        """Gap of a run: squares averaged over the records. inf for one that stopped."""
        if runs is None:
            names = {name: None for record in self.records for name in record.measured}
            return dict.fromkeys([*names, "total"], float("inf"))
        return joint_gap([record.gap(run) for record, run in zip(self.records, runs, strict=True)])

    def change(self, run: Runs, other: Runs) -> dict[str, float]:
        """By how much each signal and the total differ between two runs, as a gap: the largest of the records.

        A valve or an end stop may be reached in one of them only.
        """
        out: dict[str, float] = {}
        for record, one, two in zip(self.records, run, other, strict=True):
            for name, value in record.change(one, two).items():
                out[name] = max(out.get(name, 0.0), value)
        return out


def run_records(records: Sequence[Record], settings: Sequence[Setting]) -> list[Runs | None]:
    """Simulate each setting on each record; None if a run stopped."""
    found: list[Runs | None] = []
    for runs in zip(*(record.model.run(settings) for record in records), strict=True):
        complete = tuple(run for run in runs if run is not None)
        found.append(complete if len(complete) == len(runs) else None)
    return found


def joint_gap(gaps: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The gap over several logs: squares averaged over the logs that score a signal; `total` is the RMS of the signals.

    A signal that stands still in a log has no gap there.
    """
    if len(gaps) == 1:
        return dict(gaps[0])
    joint = mean_square_root([{name: value for name, value in one.items() if name != "total"} for one in gaps])
    return joint | {"total": float(np.sqrt(np.mean(np.square(list(joint.values()))))) if joint else 0.0}


def mean_square_root(tables: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Name -> RMS of its values over the tables that have it."""
    if len(tables) == 1:
        return dict(tables[0])
    names = dict.fromkeys(name for table in tables for name in table)
    return {
        name: float(np.sqrt(np.mean(np.square([table[name] for table in tables if name in table])))) for name in names
    }
