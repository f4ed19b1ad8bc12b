"""Segments of a log that are scored: the whole log, and the last third or a second log that no fit has seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.log import Log
from ..identification.initial_state import RUN_IN, ZERO_SPEED, estimate_states, find_initial_state
from ..physics.effects import EFFECTS, Effect
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel, Setting
from .signals import gap as signal_gap
from .signals import noise_of, scored, signal_noise

#: The share of a log that is held out where there is no second log.
HELD_OUT = 1.0 / 3.0


@dataclass(frozen=True)
class Segment:
    """A segment of a log: a model that runs over it, the first sample that is scored, the channels' noise, its name."""

    model: HypothesisModel
    first: int
    noise: Mapping[str, float]
    name: str

    def simulate(self, values: Setting) -> dict[str, np.ndarray] | None:
        """Sensor readings over the whole segment; None where the run stopped.

        The rod's position and the common level of the pressures integrate, so that an error of their first sample
        stays. Where a run-in precedes the scored part, its mean error corrects the start.
        """
        model = self.model
        found = model.run([values])[0]
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
        """The scored signals of channels, over the scored part."""
        signals = scored(self.model.plant.structure.system.scored, channels, self.model.log.sample_time)
        return {name: values[self.first :] for name, values in signals.items()}

    def gap(self, values: Setting) -> dict[str, float]:
        """Gap of each scored signal and in total."""
        return self.gap_of(self.simulate(values))

    def gap_of(self, simulated: Mapping[str, np.ndarray] | None) -> dict[str, float]:
        """The gap of a run; infinite for one that stopped."""
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
    """How far a log is from a free run of the plant, by signal.

    Parameters
    ----------
    plant: nominal, linear or nonlinear, with its load and its sensors.
    log: drives the run with its current (its drive force for a carriage).

    Returns
    -------
    The system's scored signals (speed, p1, p2, rod_velocity for the EHSA), as far as the log has them: RMS of measured
    minus simulated, the sensors' noise subtracted in quadrature, over the measured signal's standard deviation; inf
    where the run stopped. total: the RMS of these.
    """
    return whole_log(plant, plant, prepare_replay(plant, log), noise_of(log)).gap({})


def replayed_effects(plant: Plant) -> tuple[Effect, ...]:
    """Effects that the plant has and that a run applies along a measured signal."""
    found = (EFFECTS[name] for name in plant.structure.effects)
    return tuple(e for e in found if e.replay is not None and plant[e.parameters[0].name] != e.parameters[0].neutral)


def prepare_replay(plant: Plant, log: Log, reference: Log | None = None, *, everything: bool = False) -> Log:
    """The log with the channels that replayed effects follow: those of the plant, or of the whole catalogue."""
    for effect in EFFECTS.values() if everything else replayed_effects(plant):
        if effect.replay is not None:
            log = effect.replay.prepare(plant.values, log, reference)
    return log


def whole_log(plant: Plant, model_plant: Plant, log: Log, noise: Mapping[str, float]) -> Segment:
    """A whole log from its own start: at rest where it starts so, else from its first samples.

    plant: nominal, gives the start. model_plant: what runs, see `with_every_effect`.
    """
    return Segment(HypothesisModel(model_plant, log, initial_state(plant, log)), 0, noise, log.name)


def initial_state(plant: Plant, log: Log) -> dict[str, float] | None:
    """State at the first sample of a log by name; None for a log that starts at rest."""
    state = find_initial_state(plant, log, log.before).state
    names = [state.name for state in plant.structure.equations.states]
    return None if np.array_equal(state, plant.rest) else dict(zip(names, state.tolist(), strict=True))


def last_third(plant: Plant, model_plant: Plant, log: Log, noise: Mapping[str, float]) -> tuple[Log, Segment]:
    """The part to fit, and the last third, started in the state that the second before it shows."""
    edge = int(round(len(log) * (1.0 - HELD_OUT)))
    name = f"the last third of {log.name if log.path else 'the log'}, from {log.time[edge]:g} s on"
    if _has_unmeasured_state(plant, log):
        # A state without a sensor is known where the log starts, and from there on through the run alone.
        return log.rows(0, edge), replace(whole_log(plant, model_plant, log, noise), first=edge, name=name)
    back = max(edge - max(int(round(RUN_IN / log.sample_time)), 1), 0)
    estimate = estimate_states(plant, log)
    names = [state.name for state in plant.structure.equations.states]
    begin = _fastest(plant, estimate.values, estimate.sd, back, edge)
    start = dict(zip(names, estimate.values[begin].tolist(), strict=True))
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(estimate.values[begin, column]) < ZERO_SPEED * estimate.sd[begin, column]:
            start[contact.velocity] = 0.0
    for effect in map(EFFECTS.__getitem__, model_plant.structure.effects):
        start |= {s.name: float(s.along(log)[begin]) for s in effect.states if s.along is not None}
    piece = log.rows(begin, len(log))
    return log.rows(0, edge), Segment(HypothesisModel(model_plant, piece, start), edge - begin, noise, name)


def _has_unmeasured_state(plant: Plant, log: Log) -> bool:
    """Whether no channel shows a state of the system; a rod's speed is the slope of its position."""
    outputs = plant.structure.system.outputs
    seen = {state for channel, state in outputs.items() if channel in log.channels}
    seen |= {speed for speed, position in plant.structure.system.slopes.items() if position in seen}
    return any(state not in seen for state in outputs.values())


def _fastest(plant: Plant, values: np.ndarray, sd: np.ndarray, back: int, edge: int) -> int:
    """The sample near `back` at which every contact moves most clearly: a contact that sticks hides its past."""
    low, high = max(back - (edge - back) // 2, 0), back + (edge - back) // 2
    if high <= low:
        return back
    speed = np.full(high - low, np.inf)
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        speed = np.minimum(speed, np.abs(values[low:high, column]) / sd[low:high, column])
    return low + int(np.argmax(np.minimum(speed, 50.0) - np.abs(np.arange(low, high) - back) * 0.01))
