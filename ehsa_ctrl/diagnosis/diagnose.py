"""Diagnose a log: where the gap lies, which effect causes it, how far it shrinks.

    PreparedLog -> Segments -> Hypotheses -> Scoring, Selection -> Diagnosis

Each stage is frozen; the functions below make one from the last.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.log import Log, named
from ..identification.checks import check_log, raise_on_error
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .candidate_effects import candidate_effects
from .causes import reported_causes
from .diagnosis import MODELS, Cause, Diagnosis, RankedHypothesis
from .gap_attribution import Location, attribute_gap
from .hypothesis_model import (
    IN_STRIBECK,
    HypothesisModel,
    Setting,
    law_switches,
    left_out_effects,
    with_every_effect,
    without_dry_friction,
)
from .hypothesis_search import Hypotheses, Pool, Watch, search
from .improved_plant import improved_plant
from .model_selection import Reference, Selection, select_model
from .next_experiment import deciding_experiment
from .refit import objective_of, refit_nominal
from .scoring import ScoredHypothesis, Scoring, score_hypotheses, standard_deviations
from .signals import largest, noise_of
from .validation_segment import Segment, initial_state, last_third, prepare_replay, replayed_effects, whole_log
from .verdict_text import advice, name_of

#: A shorter log leaves too little to fit and to hold out [s].
SHORTEST = 3.0
#: Priors of the refit without causes are wider by this.
LOOSE = 30.0


@dataclass(frozen=True)
class PreparedLog:
    """A checked log and the plant that it is compared with.

    plant, log: as given. model: the plant with every effect, driven by the log with the channels that effects follow.
    validation: a second log, prepared likewise. noise: channel -> standard deviation. findings: warnings.
    """

    plant: Plant
    log: Log
    model: HypothesisModel
    validation: Log | None
    noise: Mapping[str, float]
    findings: tuple[str, ...]
    threshold: float


@dataclass(frozen=True)
class Segments:
    """The whole log from its start, the part that hypotheses are fitted to, and the part that is held out."""

    whole: Segment
    training: Segment
    held_out: Segment


def diagnose(
    plant: Plant,
    log: Log,
    *,
    validate: Log | None = None,
    threshold: float = 0.03,
    jobs: int | None = None,
    watch: Watch | None = None,
    check: bool = True,
) -> Diagnosis:
    """Where the gap between a log and the nominal plant lies, what causes it, and how far it shrinks.

    Parameters
    ----------
    plant: nominal, linear or nonlinear, with the load that was there.
    log: see `read_plant_log`; it may lack force or pressures.
    validate: a second log that nothing is fitted to; the last third of `log` by default.
    threshold: a gap of a signal, relative to its standard deviation, from which on it matters.
    jobs: threads; all cores by default.
    watch: is called with stage, steps done and steps in all.
    check: refuse logs that `check_log` finds wrong: a wrong sign or unit is no effect.

    Returns
    -------
    Diagnosis.

    Raises
    ------
    InputError: the log is clearly wrong or too short.
    """
    began = time.monotonic()
    prepared = prepare_log(plant, log, validate, threshold, check=check)
    segments = split_log(prepared)
    gaps = segments.whole.gap({})
    if largest(gaps) < threshold:
        gap = dict.fromkeys(MODELS, segments.held_out.gap({}))
        return _result(prepared, segments, gaps, {}, began, verdict="no_gap", where=(), effects=(), gap=gap, runs=2)
    objective, columns = objective_of(segments.training.model, prepared.noise, threshold)
    lumped = without_dry_friction(prepared.model.plant)
    pool = Pool(jobs or os.cpu_count() or 1, watch)
    hypotheses = Hypotheses.none_fitted(objective, candidate_effects(segments.training.model), columns, pool)
    hypotheses = search(hypotheses, lumped=lumped)
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, threshold, lumped=lumped)
    hypotheses, scores, superseded = score_hypotheses(hypotheses, scoring)
    selection = select_model(scores, Reference.of(scoring), threshold)
    nominal_refit = refit_nominal(objective, columns, 1.0 if lumped else LOOSE)
    known = [*superseded, *scores]
    return _explained(prepared, segments, gaps, hypotheses, scoring, selection, known, nominal_refit, began)


def prepare_log(plant: Plant, log: Log, validate: Log | None, threshold: float, *, check: bool) -> PreparedLog:
    """Check plant, logs and threshold, and prepare the logs for the model of all hypotheses."""
    check_threshold(threshold)
    log, *others = named([log] if validate is None else [log, validate])
    findings = [*_checked(plant, [log, *others], check), *(e.caveat for e in replayed_effects(plant))]
    findings += [f"{name} is not among the candidates: {reason}" for name, reason in left_out_effects(plant).items()]
    followed = prepare_replay(plant, log, everything=True)
    validation = prepare_replay(plant, others[0], followed, everything=True) if others else None
    model = HypothesisModel(with_every_effect(plant), followed, initial_state(plant, log), _switched(plant))
    return PreparedLog(plant, log, model, validation, noise_of(log), tuple(filter(None, findings)), threshold)


def check_threshold(threshold: float) -> None:
    """Raises InputError for a threshold that is no share."""
    if not 0.0 < threshold < 1.0:
        raise InputError(f"threshold = {threshold:g}; expected a share between 0 and 1, such as 0.03")


def _switched(plant: Plant) -> dict[str, Plant]:
    """The plant with each friction law that a hypothesis may switch to; presliding needs a rod that pressures move."""
    structure = plant.structure
    if plant.model != "nonlinear" or structure.chambers is None or structure.system.prescribed:
        return {}
    own = [plant.structure.law(contact) for contact in plant.structure.system.contacts if contact.name == "rod"]
    if any(law.name not in IN_STRIBECK and law.state_rate is None for law in own):
        # Neither law is contained in the other: a switch would change more than the effect does.
        return {}
    return {switch.law: with_every_effect(plant, switch.law) for switch in law_switches()}


def _checked(plant: Plant, logs: Sequence[Log], check: bool) -> list[str]:
    """Warnings on the logs; raises InputError for the first that is clearly wrong."""
    sentences = []
    for log in logs:
        for drive in plant.structure.system.drives.values():
            if drive not in log.channels:
                raise InputError(f"{log.path or 'the log'}: has no {drive}, which drives the simulation")
        findings = check_log(log, plant)
        if check:
            raise_on_error(log, findings)
        sentences += [finding.labelled(log).sentence for finding in findings]
        length = float(log.time[-1] - log.time[0])
        if length < SHORTEST:
            raise InputError(
                f"{log.path or 'the log'}: lasts {length:.3g} s; a diagnosis needs at least {SHORTEST:g} s, of which "
                "a third is held out"
            )
    return sentences


def split_log(prepared: PreparedLog) -> Segments:
    """What is fitted, and what is held out: the validation log, or else the last third."""
    plant, model = prepared.plant, prepared.model
    if prepared.validation is not None:
        training, noise = model.log, noise_of(prepared.validation)
        held_out = whole_log(plant, model.plant, prepared.validation, noise)
    else:
        training, held_out = last_third(plant, model.plant, model.log, prepared.noise)
    held_out = replace(held_out, model=replace(held_out.model, switched=model.switched))
    return Segments(
        Segment(model, 0, prepared.noise, prepared.log.name),
        Segment(replace(model, log=training), 0, prepared.noise, "the training data"),
        held_out,
    )


def _result(
    prepared: PreparedLog,
    segments: Segments,
    gaps: Mapping[str, float],
    values: Mapping[str, Setting],
    began: float,
    findings: Sequence[str] = (),
    **found: Any,
) -> Diagnosis:
    """A diagnosis with what every verdict has: logs, noise, segments and free runs over the whole log."""
    held_out = segments.held_out
    own = held_out.model.log
    runs = {model: segments.whole.simulate(setting) for model, setting in {"nominal": {}, **values}.items()}
    return Diagnosis(
        plant=prepared.plant,
        log=prepared.log,
        threshold=prepared.threshold,
        whole=gaps,
        held_out=held_out.name,
        held_from=float(own.time[held_out.first]) if own.path == prepared.log.path and held_out.first > 0 else None,
        noise_sd=prepared.noise,
        values=values,
        simulated={model: run for model, run in runs.items() if run is not None},
        findings=tuple(dict.fromkeys([*prepared.findings, *findings])),
        seconds=time.monotonic() - began,
        provenance=versions(),
        **found,
    )


def _explained(
    prepared: PreparedLog,
    segments: Segments,
    gaps: Mapping[str, float],
    hypotheses: Hypotheses,
    scoring: Scoring,
    selection: Selection,
    known: Sequence[ScoredHypothesis],
    nominal_refit: Setting,
    began: float,
) -> Diagnosis:
    """The result of a selected model."""
    plant, log, chosen, held_out = prepared.plant, prepared.log, selection.chosen, segments.held_out
    with_effects = chosen.fit.values if selection.named else nominal_refit
    values: dict[str, Setting] = {"nominal": {}, "refit": nominal_refit, "with_effects": with_effects}
    location = attribute_gap(plant, log, prepared.noise)
    gap = {model: held_out.gap(setting) for model, setting in values.items()}
    gap["upper_bound"] = _upper_bound(gap, location)
    sd = standard_deviations(chosen.fit, scoring.weight)
    causes: tuple[Cause, ...] = ()
    if selection.verdict != "outside_catalogue":
        causes = reported_causes(plant, selection, scoring, known, sd, gap, log)
    # Effects that no log can tell apart make an ambiguous set too.
    ambiguous = selection.verdict == "effect" and any(cause.ambiguous_with for cause in causes)
    verdict = "ambiguous" if ambiguous else selection.verdict
    experiment = deciding_experiment(selection, hypotheses, prepared.noise)
    changed = {n: v for n, v in chosen.fit.values.items() if v != prepared.model.nominal_value(n)}
    least = selection.ranked[0].deviance
    return _result(
        prepared,
        segments,
        gaps,
        values,
        began,
        findings=[EFFECTS[id].caveat for id, _ in chosen.causes if selection.named and EFFECTS[id].caveat],
        verdict=verdict,
        where=_where(location, causes),
        effects=causes,
        gap=gap,
        candidates=tuple(
            RankedHypothesis(tuple(map(name_of, one.label)), one.deviance - least, largest(one.held_out))
            for one in selection.ranked
        ),
        location=location,
        next_experiment=experiment.words if experiment else advice(verdict, causes, plant.structure.system),
        experiment=experiment,
        improved=improved_plant(plant, chosen.fit.candidates, changed, sd) if selection.named else None,
        runs=hypotheses.objective.count.total,
    )


def _where(location: Location, causes: Sequence[Cause]) -> tuple[tuple[str, float], ...]:
    """Shares of the places. Places whose balances no sensor shows share by what the causes that act there close."""
    shares = dict(location.shares)
    closed = dict.fromkeys(location.silent, 0.0)
    for cause in causes:
        if cause.place in closed:
            closed[cause.place] += max(cause.gap_closed or 0.0, 0.0)
    whole = sum(closed.values())
    if whole > 0.0:
        hidden = sum(shares[place] for place in closed)
        shares |= {place: hidden * part / whole for place, part in closed.items()}
    return tuple(sorted(shares.items(), key=lambda row: -row[1]))


def _upper_bound(gap: Mapping[str, Mapping[str, float]], location: Location) -> dict[str, float]:
    """What a model of any form could reach: the nominal gap without the parts that unknown inputs close over the whole
    log, or the best model's gap if that is less."""
    bound = {}
    for signal, nominal in gap["nominal"].items():
        if signal == "total":
            continue
        parts = {name: part for name, part in location.by_signal.get(signal, {}).items() if name != "gap"}
        free = nominal * float(np.sqrt(np.clip(1.0 - sum(parts.values()), 0.0, 1.0)))
        bound[signal] = min(free, *(gaps[signal] for gaps in gap.values()))
    bound["total"] = float(np.sqrt(np.mean([value**2 for value in bound.values()])))
    return bound
