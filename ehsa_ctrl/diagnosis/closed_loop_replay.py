"""Closed-loop replay: the models of a diagnosis under the controller with which their log was recorded.

A free run is driven by the logged drive, so that position drifts and an unstable plant leaves its log. Here the
controller gets the logged reference and the simulated readings of the declared sensors, and position can be scored. The
loop corrects what differs, so that a cause shows less in its outputs than in a free run, and more in the drive: the
gaps of both replays belong together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..core.controller_interface import MEASURED, Controller
from ..core.errors import InputError
from ..core.log import Log
from ..core.result import as_dict
from ..identification.initial_state import find_initial_state
from ..plant.plant import Plant
from ..plant.system import ScoredSignal
from ..simulation.closed_loop import ClosedLoop, run_closed_loop
from ..simulation.sensors import Sensors
from .diagnose import upper_bound
from .diagnosis import Diagnosis
from .improved_plant import improved_plant
from .logged_reference import controller_output, output_lag, reference_of, sampled_by
from .signals import gap, moving_signals, noise_of, scored_signals, signal_noise

#: A logged drive that differs from the controller's output by more than this share of its standard deviation was
#: probably recorded with another controller (engineering judgement; with the right one it is 0.7 % on the EMPS record).
MAX_DRIVE_DIFFERENCE = 0.2
#: Share of the samples at the limit of the drive from which a finding says so. Engineering judgement.
OFTEN_LIMITED = 0.01
#: Simulations with sensor noise for the floor. Engineering judgement: their spread is some 5 %.
REHEARSALS = 3


@dataclass(frozen=True)
class ClosedLoopReplay:
    """A log compared with simulations of the loop under which it was recorded.

    Attributes
    ----------
    controller: its name. lag: samples between a reading and the drive that the controller computes from it.
    gap: model -> signal -> gap on the held-out data, position included. whole: the same over the whole log.
    floor: signal -> gap that sensor noise makes through the loop by itself.
    position_error: model -> RMS of measured minus simulated position [m]. drive_gap: model -> gap of the drive.
    tracking_error: RMS of logged reference minus measured position [m].
    drive_difference: RMS of the logged drive minus the controller's output on the logged readings, over the standard
        deviation of the logged drive; nan if the log lacks a reading.
    time: (N,) s. measured, simulated: channel -> (N,), the latter by model, of position and drive over the whole log.
    """

    controller: str
    lag: int
    gap: Mapping[str, Mapping[str, float]]
    whole: Mapping[str, Mapping[str, float]]
    floor: Mapping[str, float]
    position_error: Mapping[str, float]
    drive_gap: Mapping[str, float]
    tracking_error: float
    drive_difference: float
    time: np.ndarray = field(repr=False)
    measured: Mapping[str, np.ndarray] = field(repr=False)
    simulated: Mapping[str, Mapping[str, np.ndarray]] = field(repr=False)

    @property
    def improved_gap(self) -> Mapping[str, float]:
        """Signal -> gap that the improved plant leaves; it is the last of the models."""
        return list(self.gap.values())[-1]

    @property
    def seconds(self) -> float:
        """Time that log and simulations have in common [s]."""
        return float(self.time[-1] - self.time[0])

    def to_dict(self) -> dict[str, Any]:
        """As under `closed_loop_replay` in diagnosis.json; the gaps stand under `closed_loop`."""
        names = "controller lag floor position_error drive_gap tracking_error drive_difference seconds"
        return as_dict(self, names, gap_whole_log=self.whole)


@dataclass(frozen=True)
class LoopCase:
    """The loop of a log.

    controller, log: the log by the samples of the controller. scored: (N,) whether a sample is. lag: see
    ClosedLoopReplay. run: (plant, lag, seed of the sensor noise or None for none) -> simulation.
    """

    controller: Controller
    log: Log
    reference: np.ndarray
    scored: np.ndarray
    run: Callable[[Plant, int, int | None], ClosedLoop]
    lag: int | None = None


def replay_closed_loop(diagnosis: Diagnosis, controller: Controller, *, validate: Log | None = None) -> Diagnosis:
    """The diagnosis with the closed-loop gaps of its models: `closed_loop` of the result.

    Parameters
    ----------
    diagnosis: what `diagnose` gives.
    controller: the one under which the log was recorded, designed as on the rig.
    validate: the second log, if it was validated on one.

    Raises InputError for a log without the channel `reference`, and for a controller of another sample time.
    """
    log = diagnosis.log if validate is None else validate
    plant = diagnosis.plant
    if plant.structure.system.no_controller:
        raise InputError(f"{plant.name}: {plant.structure.system.no_controller}; leave the controller out")
    sampled, reference = sampled_by(log, controller), reference_of(log, controller)
    scored = held_out_samples(diagnosis, sampled) if validate is None else np.ones(len(sampled), dtype=bool)

    def run(model: Plant, lag: int, seed: int | None) -> ClosedLoop:
        return run_closed_loop(
            model, controller, reference, sensors=Sensors.of(model, seed=seed or 0, noise=seed is not None), lag=lag,
            start=find_initial_state(model, log, log.before).state, raise_on_failure=False,
        )  # fmt: skip

    replayed, findings = replay_loop(diagnosis, LoopCase(controller, sampled, reference, scored, run))
    return replace(diagnosis, closed_loop=replayed, findings=tuple(dict.fromkeys([*diagnosis.findings, *findings])))


def held_out_samples(diagnosis: Diagnosis, log: Log) -> np.ndarray:
    """(N,) whether a sample of the diagnosed log is held out; all of them if the diagnosis has a second log."""
    slack = 1e-6 * log.sample_time
    parts = [(log.time >= start - slack) & (log.time <= stop + slack) for start, stop in diagnosis.held_spans]
    return np.any(parts, axis=0) if parts else np.ones(len(log), dtype=bool)


def replay_loop(found: Diagnosis, case: LoopCase) -> tuple[ClosedLoopReplay, list[str]]:
    """The closed-loop gaps of a diagnosis' models, and findings in sentences."""
    log, system = case.log, found.plant.structure.system
    n = min(len(log), len(case.reference))
    output = controller_output(case.controller, case.reference[:n], log)
    lag, difference = output_lag(log[system.drive][:n], output) if case.lag is None else (case.lag, float("nan"))
    if case.lag is not None and output is not None:
        _, difference = output_lag(log[system.drive][:n], output, (case.lag,))
    noise = found.noise_sd if log.path == found.log.path else noise_of(found.plant, log)
    rows = case.scored[:n] if case.scored[:n].any() else np.ones(n, dtype=bool)
    score = _Score(found.plant, log, rows, noise)
    models = models_of(found)
    loops = {model: case.run(plant, lag, None) for model, plant in models.items()}
    gaps: dict[str, Mapping[str, float]] = {model: score.gap(_readings(loop)) for model, loop in loops.items()}
    word, best = list(models.items())[-1]
    gaps["upper_bound"] = upper_bound(gaps, found.location) if found.location is not None else gaps["nominal"]
    channels = {model: _readings(loop) | {"drive": loop.trajectory.current} for model, loop in loops.items()}
    measured = {channel: log[channel][:n] for channel in system.positions} | {"drive": log[system.drive][:n]}
    position = next(iter(system.positions))
    replayed = ClosedLoopReplay(
        case.controller.name, lag, gaps,
        {model: replace(score, rows=np.ones(n, dtype=bool)).gap(_readings(loop)) for model, loop in loops.items()},
        score.floor([_readings(case.run(best, lag, seed)) for seed in range(REHEARSALS)], loops[word], best),
        {model: score.rms(log[position], run[position]) for model, run in channels.items()},
        {model: score.rms(log[system.drive], run["drive"], relative=True) for model, run in channels.items()},
        score.rms(case.reference[:n, 0], log[position]), difference, log.time[:n], measured,
        {model: {name: run[name] for name in measured} for model, run in channels.items()},
    )  # fmt: skip
    return replayed, _findings(found, case, replayed, loops)


def models_of(found: Diagnosis) -> dict[str, Plant]:
    """Model of a diagnosis -> plant: nominal, with refitted parameters, with the causes, and with a law if there is
    one. The last one is the improved plant."""
    refit = found.values.get("refit", {})
    refitted = improved_plant(found.plant, (), refit, {}) if refit else found.plant
    improved = found.improved or found.plant
    models = {"nominal": found.plant, "refit": refitted, "with_effects": found.with_causes or improved}
    return models | ({"with_law": improved} if found.law is not None else {})


@dataclass(frozen=True)
class _Score:
    """Comparison of a log's first samples with a run; rows: (n,) whether a sample is scored."""

    plant: Plant
    log: Log
    rows: np.ndarray
    noise: Mapping[str, float]

    @property
    def signals(self) -> tuple[ScoredSignal, ...]:
        """The scored signals of the system, and its positions."""
        system = self.plant.structure.system
        whole = {one.channel for one in system.scored if not one.span}
        return (*system.scored, *(ScoredSignal(c, c) for c in system.positions if c not in whole))

    def _scored(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        signals = scored_signals(self.signals, channels, self.log.sample_time)
        return {name: values[: self.rows.size][self.rows] for name, values in signals.items()}

    def gap(self, channels: Mapping[str, np.ndarray], measured: Mapping[str, np.ndarray] | None = None) -> Any:
        """Gap of each signal that both have and that moves; inf for a run that stopped."""
        dt = self.log.sample_time
        noise, declared = (
            signal_noise(self.signals, sd, dt)
            for sd in (self.noise, {channel: sensor.sd for channel, sensor in self.plant.sensors.items()})
        )
        shown = self._scored(self.log.channels if measured is None else measured)
        moving = moving_signals(self._scored(self.log.channels), noise, declared)
        known = {name: values for name, values in shown.items() if name in moving}
        if len(next(iter(channels.values()))) < self.rows.size:
            return {**dict.fromkeys(known, float("inf")), "total": float("inf")}
        return gap(known, self._scored(channels), noise)

    def floor(self, noisy: list[dict[str, np.ndarray]], quiet: ClosedLoop, plant: Plant) -> dict[str, float]:
        """Gap between runs with the declared sensor noise and the one without it."""
        declared = {channel: plant.sensors[channel].sd for channel in plant.sensors}
        score, known = replace(self, noise=declared), set(self.log.channels)
        rows = [score.gap(_readings(quiet), {c: v for c, v in run.items() if c in known}) for run in noisy]
        return {name: float(np.sqrt(np.mean([row[name] ** 2 for row in rows]))) for name in rows[0]}

    def rms(self, measured: np.ndarray, simulated: np.ndarray, *, relative: bool = False) -> float:
        """RMS of the difference over the scored samples, or over the standard deviation; nan for a stopped run."""
        n = self.rows.size
        if simulated.size < n:
            return float("nan")
        value = float(np.sqrt(np.mean((measured[:n] - simulated[:n])[self.rows] ** 2)))
        spread = float(np.std(measured[:n][self.rows]))
        return value / spread if relative and spread > 0.0 else value


def _readings(loop: ClosedLoop) -> dict[str, np.ndarray]:
    """Channel -> (N,) reading that the controller got."""
    return dict(zip(MEASURED, loop.measured.T, strict=True))


def _findings(
    found: Diagnosis, case: LoopCase, replayed: ClosedLoopReplay, loops: Mapping[str, ClosedLoop]
) -> list[str]:
    """What makes the closed-loop replay doubtful, in sentences."""
    drive, unit = found.plant.structure.system.drive, found.plant.structure.system.drive_unit
    name, sentences = case.controller.name, []
    if replayed.drive_difference > MAX_DRIVE_DIFFERENCE:
        sentences.append(
            f"the logged {drive} differs by {100.0 * replayed.drive_difference:.0f} % of its standard deviation from "
            f"the output of {name} on the logged readings: check that the log was recorded with this controller"
        )
    if case.lag is None and replayed.lag:
        late = 1e3 * replayed.lag * case.controller.sample_time
        sentences.append(f"the logged {drive} follows the output of {name} {late:.3g} ms later, as in the replay")
    limit = float(getattr(case.controller, "current_limit", np.inf))
    share = float(np.mean(np.abs(loops["nominal"].asked) >= limit * (1.0 - 1e-9)))
    if share > OFTEN_LIMITED:
        sentences.append(
            f"{name} is at its limit of {limit:g} {unit} for {100.0 * share:.0f} % of the closed-loop replay, where "
            "the loop is open and position may drift"
        )
    for model, loop in loops.items():
        if loop.trajectory.stopped:
            sentences.append(f"closed-loop replay of the model {model!r}: {loop.trajectory.stopped}")
    return sentences
