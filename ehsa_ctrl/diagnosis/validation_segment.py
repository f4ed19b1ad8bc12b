"""Records of a log for segments: the whole log, or parts of it with a run-in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.log import Log
from ..identification.initial_state import RUN_IN, ZERO_SPEED, StateEstimate, estimate_states, find_initial_state
from ..identification.logged_inputs import logged_inputs
from ..physics.effects import EFFECTS, Effect
from ..plant.plant import Plant
from .hypothesis_model import HypothesisModel
from .law.begin import courses
from .records import Record, Segment
from .signals import noise_of
from .unknown_inputs import balance_signals

#: Length of a window [s]. Engineering judgement: longer than a slip's consequences, a few times the run-in at most.
WINDOW = 2.0


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
    record = whole_log(plant, plant, prepare_replay(plant, log), noise_of(plant, log))
    return Segment((record,), log.name).gap({})


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


def whole_log(plant: Plant, model_plant: Plant, log: Log, noise: Mapping[str, float]) -> Record:
    """A whole log as a record, from rest or from the state that its first samples show.

    plant: nominal, for the initial state. model_plant: the plant that is simulated, see `with_every_effect`.
    """
    return Record(HypothesisModel(model_plant, log, initial_state(plant, log)), noise)


def initial_state(plant: Plant, log: Log) -> dict[str, float] | None:
    """State -> value at the first sample of a log; None if it starts at rest."""
    state = find_initial_state(plant, log, log.before).state
    names = [state.name for state in plant.structure.equations.states]
    return None if np.array_equal(state, plant.rest) else dict(zip(names, state.tolist(), strict=True))


def part_of_log(
    plant: Plant,
    model: HypothesisModel,
    noise: Mapping[str, float],
    parts: Sequence[slice],
    estimate: StateEstimate | None = None,
) -> Record:
    """Parts of a model's log as a record: the run begins with the log, or a run-in before a single part.

    plant: nominal, for the state at the run-in. estimate: of the log's states, if it is known.
    """
    log, begin, end = model.log, parts[0].start, parts[-1].stop
    # A state without a sensor is known only at the start of the log.
    if begin == 0 or len(parts) > 1 or has_unmeasured_state(plant, log):
        return Record(replace(model, log=log.rows(0, end)), noise, tuple(parts))
    back = max(begin - max(int(round(RUN_IN / log.sample_time)), 1), 0)
    estimate = estimate or estimate_states(plant, log)
    names = [state.name for state in plant.structure.equations.states]
    run_in = _fastest_sample(plant, estimate.values, estimate.sd, back, begin)
    start = dict(zip(names, estimate.values[run_in].tolist(), strict=True))
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(estimate.values[run_in, column]) < ZERO_SPEED * estimate.sd[run_in, column]:
            start[contact.velocity] = 0.0
    for effect in map(EFFECTS.__getitem__, model.plant.structure.effects):
        start |= {s.name: float(s.along(log, plant.values)[run_in]) for s in effect.states if s.along is not None}
        start |= _states_of_law(plant, log, effect, run_in)
    piece = replace(model, log=log.rows(run_in, end), start=start)
    return Record(piece, noise, (slice(begin - run_in, end - run_in),))


def _states_of_law(plant: Plant, log: Log, effect: Effect, at: int) -> dict[str, float]:
    """The states of an effect from a TOML file at a sample, by their rates along the measured signals."""
    if effect.law is None or not effect.states:
        return {}
    drive, second_input = logged_inputs(plant, log)
    signals = balance_signals(plant, log, drive, {}, second_input=second_input)
    law = effect.law.definition
    values = {name: plant.values.get(name, one.value) for name, one in law.parameters.items()}
    known = {name: course[:-1] for name, course in signals.values.items()}
    if not set(law.variables) <= set(known):
        return {}
    return {name: float(course[at]) for name, course in courses(law, values, known, log.sample_time).items()}


def windows_of(plants: Sequence[Plant], segment: Segment) -> Segment | None:
    """The segment in windows of WINDOW, each from the state that the log shows there; None where it does not show it.

    plants: nominal, of each record, for these states.
    """
    found = []
    for plant, record in zip(plants, segment.records, strict=True):
        log = record.model.log
        if has_unmeasured_state(plant, log):
            return None
        estimate = estimate_states(plant, log)
        for part in record.parts:
            begin, end, _ = part.indices(len(log))
            count = max(int(round((end - begin) * log.sample_time / WINDOW)), 1)
            edges = np.round(np.linspace(begin, end, count + 1)).astype(int).tolist()
            pairs = zip(edges[:-1], edges[1:], strict=True)
            found += [part_of_log(plant, record.model, record.noise, [slice(a, b)], estimate) for a, b in pairs]
    return Segment(tuple(found), segment.name)


def windows_by_log(plants: Sequence[Plant], segment: Segment) -> tuple[Segment, ...] | None:
    """The windows of each log of a segment; None as for `windows_of`."""
    pairs = zip(plants, segment.records, strict=True)
    found = [windows_of([plant], replace(segment, records=(record,))) for plant, record in pairs]
    shown = tuple(one for one in found if one is not None)
    return shown if len(shown) == len(found) else None


def has_unmeasured_state(plant: Plant, log: Log) -> bool:
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
