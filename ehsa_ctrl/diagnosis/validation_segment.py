"""Segments of a log: the whole log, and the data held out for validation (the last third, or a second log)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.log import Log
from ..identification.initial_state import RUN_IN, ZERO_SPEED, estimate_states, find_initial_state
from ..physics.effects import EFFECTS, Effect
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel, Setting
from .signals import estimate_noise, scored_signals, signal_noise
from .signals import gap as signal_gap

#: Share of a log that is held out if there is no second log.
HELD_OUT = 1.0 / 3.0


@dataclass(frozen=True)
class Segment:
    """A segment of a log.

    model: runs over the segment. first: first sample that is scored; a run-in precedes it. noise: channel -> standard
    deviation. name: for results.
    """

    model: HypothesisModel
    first: int
    noise: Mapping[str, float]
    name: str

    def simulate(self, values: Setting) -> dict[str, np.ndarray] | None:
        """Channel -> sensor reading (N,) over the segment with its run-in; None if the run stopped.

        Rod position and mean pressure integrate, so that an error of their initial values does not decay. Their mean
        error over the run-in corrects the initial values.
        """
        return self.with_corrected_start(values, self.model.run([values])[0])

    def with_corrected_start(
        self, values: Setting, found: dict[str, np.ndarray] | None
    ) -> dict[str, np.ndarray] | None:
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
        return replace(model, start=start).run([values])[0] or found

    def scored(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Name -> scored signal over the scored part, from channels."""
        signals = scored_signals(self.model.plant.structure.system.scored, channels, self.model.log.sample_time)
        return {name: values[self.first :] for name, values in signals.items()}

    def gap(self, values: Setting) -> dict[str, float]:
        """Gap of each scored signal and in total."""
        return self.gap_of(self.simulate(values))

    def gap_of(self, simulated: Mapping[str, np.ndarray] | None) -> dict[str, float]:
        """Gap of a run; inf for one that stopped."""
        log = self.model.log
        measured = self.scored({channel: log[channel] for channel in self.model.channels})
        if simulated is None:
            return {**dict.fromkeys(measured, float("inf")), "total": float("inf")}
        return signal_gap(
            measured,
            self.scored(simulated),
            signal_noise(self.model.plant.structure.system.scored, self.noise, log.sample_time),
        )


def gap(plant: Plant, log: Log) -> dict[str, float]:
    """Gap between a log and a free run of the plant.

    Parameters
    ----------
    plant: linear or nonlinear, with its load and sensors.
    log: its current drives the run (the drive force for a carriage).

    Returns
    -------
    Scored signal (speed, p1, p2, rod_velocity for the EHSA) -> RMS of measured minus simulated, with the noise
    subtracted in quadrature, divided by the standard deviation of the measured signal; inf if the run stopped. Signals
    that the log lacks are left out. "total" is the RMS of the others.
    """
    return whole_log(plant, plant, prepare_replay(plant, log), estimate_noise(log)).gap({})


def replayed_effects(plant: Plant) -> tuple[Effect, ...]:
    """Effects of the plant that a simulation applies along a measured signal."""
    found = (EFFECTS[name] for name in plant.structure.effects)
    return tuple(e for e in found if e.replay is not None and plant[e.parameters[0].name] != e.parameters[0].neutral)


def prepare_replay(plant: Plant, log: Log, reference: Log | None = None, *, all_effects: bool = False) -> Log:
    """The log with the channels that replayed effects follow: the plant's, or with `all_effects` the catalogue's.

    reference: log with which the channels are in phase.
    """
    for effect in EFFECTS.values() if all_effects else replayed_effects(plant):
        if effect.replay is not None:
            log = effect.replay.prepare(plant.values, log, reference)
    return log


def whole_log(plant: Plant, model_plant: Plant, log: Log, noise: Mapping[str, float]) -> Segment:
    """A whole log as a segment, from rest or from the state that its first samples show.

    plant: nominal, for the initial state. model_plant: the plant that is simulated, see `with_every_effect`.
    """
    return Segment(HypothesisModel(model_plant, log, initial_state(plant, log)), 0, noise, log.name)


def initial_state(plant: Plant, log: Log) -> dict[str, float] | None:
    """State -> value at the first sample of a log; None if it starts at rest."""
    state = find_initial_state(plant, log, log.before).state
    names = [state.name for state in plant.structure.equations.states]
    return None if np.array_equal(state, plant.rest) else dict(zip(names, state.tolist(), strict=True))


def last_third(plant: Plant, model_plant: Plant, log: Log, noise: Mapping[str, float]) -> tuple[Log, Segment]:
    """The log without its last third, and the last third as a segment, started from a state before it."""
    edge = int(round(len(log) * (1.0 - HELD_OUT)))
    name = f"the last third of {log.name if log.path else 'the log'}, from {log.time[edge]:g} s on"
    if _has_unmeasured_state(plant, log):
        # A state without a sensor is known only at the start of the log.
        return log.rows(0, edge), replace(whole_log(plant, model_plant, log, noise), first=edge, name=name)
    back = max(edge - max(int(round(RUN_IN / log.sample_time)), 1), 0)
    estimate = estimate_states(plant, log)
    names = [state.name for state in plant.structure.equations.states]
    begin = _fastest_sample(plant, estimate.values, estimate.sd, back, edge)
    start = dict(zip(names, estimate.values[begin].tolist(), strict=True))
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(estimate.values[begin, column]) < ZERO_SPEED * estimate.sd[begin, column]:
            start[contact.velocity] = 0.0
    for effect in map(EFFECTS.__getitem__, model_plant.structure.effects):
        start |= {s.name: float(s.along(log, plant.values)[begin]) for s in effect.states if s.along is not None}
    piece = log.rows(begin, len(log))
    return log.rows(0, edge), Segment(HypothesisModel(model_plant, piece, start), edge - begin, noise, name)


def _has_unmeasured_state(plant: Plant, log: Log) -> bool:
    """Whether a measurable state of the system has no channel in the log; a rod's speed follows from its position."""
    outputs = plant.structure.system.outputs
    seen = {state for channel, state in outputs.items() if channel in log.channels}
    seen |= {speed for speed, position in plant.structure.system.slopes.items() if position in seen}
    return any(state not in seen for state in outputs.values())


def _fastest_sample(plant: Plant, values: np.ndarray, sd: np.ndarray, back: int, edge: int) -> int:
    """The sample near `back` at which all contacts move fastest: the state of a sticking contact is uncertain."""
    low, high = max(back - (edge - back) // 2, 0), back + (edge - back) // 2
    if high <= low:
        return back
    speed = np.full(high - low, np.inf)
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        speed = np.minimum(speed, np.abs(values[low:high, column]) / sd[low:high, column])
    return low + int(np.argmax(np.minimum(speed, 50.0) - np.abs(np.arange(low, high) - back) * 0.01))
