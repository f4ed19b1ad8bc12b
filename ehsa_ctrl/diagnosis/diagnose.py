"""The stages of a diagnosis.

    PreparedLog -> Segments -> Hypotheses -> Scoring, Selection -> Diagnosis

Each stage is an immutable object; the functions below compute it from the previous ones.
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
from ..core.parallel import one_blas_thread
from ..identification.checks import check_log, raise_on_error
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .candidate_effects import candidate_effects
from .causes import build_causes, related_effects
from .diagnosis import MODELS, Cause, Diagnosis, RankedHypothesis
from .explanation import explain, only_parameters, with_absorbed_parameters
from .gap_attribution import Location, attribute_gap
from .hypothesis_model import (
    STRIBECK_SPECIAL_CASES,
    HypothesisModel,
    Setting,
    inapplicable_effects,
    lacks_dry_friction,
    law_switches,
    with_every_effect,
)
from .hypothesis_search import Hypotheses, Pool, Watch, search
from .improved_plant import improved_plant
from .model_selection import Reference, Selection, select_model
from .next_experiment import deciding_experiment
from .refit import objective_of, refit_nominal
from .scoring import ScoredHypothesis, Scoring, effect_id_by_parameter, score_hypotheses
from .several_parameters import may_be_several, with_several_parameters
from .signals import estimate_noise, largest
from .validation_segment import Segment, initial_state, last_third, prepare_replay, replayed_effects, whole_log
from .verdict_text import advice, name_of

#: Shortest log [s]. Engineering judgement: 2 s to fit and 1 s to hold out.
SHORTEST = 3.0
#: Factor on the prior deviations when only nominal parameters are refitted. Engineering judgement: practically no
#: prior, so that the refit shows the most that wrong parameters can explain.
REFIT_PRIOR_FACTOR = 30.0


@dataclass(frozen=True)
class PreparedLog:
    """A checked log and the model that is compared with it.

    plant, log: as given. model: the plant with every effect, and the log with the channels that replayed effects need.
    validation: second log with the same channels. noise: channel -> standard deviation, SI units. findings: warnings.
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
    """The whole log, the part for fitting, and the part held out for validation."""

    whole: Segment
    training: Segment
    held_out: Segment


@one_blas_thread()
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
    """Find where a log differs from the nominal plant, which effect is the cause, and how much of the gap it closes.

    Parameters
    ----------
    plant: nominal plant, linear or nonlinear, with the load of the experiment.
    log: measured log, see `read_plant_log`; force and pressures may be missing.
    validate: second log for validation; by default the last third of `log` is held out.
    threshold: smallest relevant gap of a signal, as a share of its standard deviation.
    jobs: number of threads; all cores by default.
    watch: progress callback, called with stage, steps done and total steps.
    check: reject a log in which `check_log` finds an error: a wrong sign or unit is not an effect.

    Returns
    -------
    Diagnosis.

    Raises
    ------
    InputError: the log has an error, lasts less than SHORTEST or lacks the channel of the drive; no model can be
        simulated on it; or threshold is not between 0 and 1.
    """
    began = time.monotonic()
    prepared = prepare_log(plant, log, validate, threshold, check=check)
    segments = split_log(prepared)
    gaps = segments.whole.gap({})
    if largest(gaps) < threshold:
        gap = dict.fromkeys(MODELS, segments.held_out.gap({}))
        return _build_diagnosis(
            prepared, segments, gaps, {}, began, verdict="no_gap", where=(), effects=(), gap=gap, runs=2
        )
    objective, sensitivities = objective_of(segments.training.model, prepared.noise, threshold)
    lumped = lacks_dry_friction(prepared.model.plant)
    pool = Pool(jobs or os.cpu_count() or 1, watch)
    hypotheses = Hypotheses.initial(objective, candidate_effects(segments.training.model), sensitivities, pool)
    hypotheses, screening = search(hypotheses, lumped=lumped)
    if not lumped and may_be_several(hypotheses):
        ids = effect_id_by_parameter(prepared.model.plant)
        hypotheses = with_several_parameters(hypotheses, screening, ids, threshold)
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, threshold, lumped=lumped)
    hypotheses, scores, superseded = score_hypotheses(hypotheses, scoring)
    reference = Reference.of(scoring)
    selection = select_model(scores, reference, threshold)
    selection, hypotheses = with_absorbed_parameters(selection, hypotheses, scoring, reference, threshold)
    nominal_refit = refit_nominal(objective, sensitivities, 1.0 if lumped else REFIT_PRIOR_FACTOR)
    known = [*superseded, *scores]
    return _diagnose_selection(
        prepared, segments, gaps, hypotheses, scoring, reference, selection, known, nominal_refit, began
    )


def prepare_log(plant: Plant, log: Log, validate: Log | None, threshold: float, *, check: bool) -> PreparedLog:
    """Check threshold and logs, and set up the model of all hypotheses.

    Raises InputError as `diagnose`.
    """
    check_threshold(threshold)
    log, *others = named([log] if validate is None else [log, validate])
    findings = [*_check_logs(plant, [log, *others], check), *(e.caveat for e in replayed_effects(plant))]
    findings += [f"effect {name} was not tested: {reason}" for name, reason in inapplicable_effects(plant).items()]
    prepared = prepare_replay(plant, log, all_effects=True)
    validation = prepare_replay(plant, others[0], prepared, all_effects=True) if others else None
    model = HypothesisModel(with_every_effect(plant), prepared, initial_state(plant, log), _plants_by_law(plant))
    return PreparedLog(plant, log, model, validation, estimate_noise(log), tuple(filter(None, findings)), threshold)


def check_threshold(threshold: float) -> None:
    """Raises InputError unless the threshold is a share between 0 and 1."""
    if not 0.0 < threshold < 1.0:
        raise InputError(f"threshold = {threshold:g}; expected a share between 0 and 1, such as 0.03")


def _plants_by_law(plant: Plant) -> dict[str, Plant]:
    """Friction law -> the plant with this law, for hypotheses that replace the rod's friction law.

    Empty where no replacement is possible: presliding needs a rod that the chamber pressures move.
    """
    structure = plant.structure
    if plant.model != "nonlinear" or structure.chambers is None or structure.system.prescribed:
        return {}
    own = [plant.structure.law(contact) for contact in plant.structure.system.contacts if contact.name == "rod"]
    if any(law.name not in STRIBECK_SPECIAL_CASES and law.state_rate is None for law in own):
        # The two laws are not nested: replacing one by the other would change more than the effect does.
        return {}
    return {switch.law: with_every_effect(plant, switch.law) for switch in law_switches()}


def _check_logs(plant: Plant, logs: Sequence[Log], check: bool) -> list[str]:
    """Warnings on the logs.

    Raises InputError for a log that is too short, lacks the channel of the drive or, with `check`, has an error.
    """
    sentences = []
    for log in logs:
        for drive in plant.structure.system.drives.values():
            if drive not in log.channels:
                raise InputError(
                    f"{log.path or 'the log'}: has no channel {drive}, which drives the simulation; record it, or map "
                    "it in the plant's [log] table"
                )
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
    """The segments: the validation log is held out, or else the last third of the log."""
    plant, model = prepared.plant, prepared.model
    if prepared.validation is not None:
        training, noise = model.log, estimate_noise(prepared.validation)
        held_out = whole_log(plant, model.plant, prepared.validation, noise)
    else:
        training, held_out = last_third(plant, model.plant, model.log, prepared.noise)
    held_out = replace(held_out, model=replace(held_out.model, plants_by_law=model.plants_by_law))
    return Segments(
        Segment(model, 0, prepared.noise, prepared.log.name),
        Segment(replace(model, log=training), 0, prepared.noise, "the training data"),
        held_out,
    )


def _build_diagnosis(
    prepared: PreparedLog,
    segments: Segments,
    gaps: Mapping[str, float],
    values: Mapping[str, Setting],
    began: float,
    findings: Sequence[str] = (),
    **found: Any,
) -> Diagnosis:
    """The result, with the fields that do not depend on the verdict; `found` holds the others.

    gaps: of the nominal plant over the whole log. values: model -> setting, for its free run over the whole log. began:
    start of the computation by the monotonic clock [s].
    """
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


def _diagnose_selection(
    prepared: PreparedLog,
    segments: Segments,
    gaps: Mapping[str, float],
    hypotheses: Hypotheses,
    scoring: Scoring,
    reference: Reference,
    selection: Selection,
    known: Sequence[ScoredHypothesis],
    nominal_refit: Setting,
    began: float,
) -> Diagnosis:
    """The result where there is a gap.

    known: all hypotheses that were scored. nominal_refit: nominal parameters refitted without any effect.
    """
    plant, log, chosen, held_out = prepared.plant, prepared.log, selection.chosen, segments.held_out
    sd = scoring.standard_deviations(chosen.fit)
    changed = {n: v for n, v in chosen.fit.values.items() if v != prepared.model.nominal_value(n)}
    improved = improved_plant(plant, chosen.fit.candidates, changed, sd)
    explanation = explain(
        selection, reference, prepared.threshold, improved, log, prepared.noise, len(segments.training.model.log),
        prepared.validation,
    )  # fmt: skip
    selection = replace(selection, verdict=explanation.verdict)
    if not selection.named:
        refitted = {n: v for n, v in nominal_refit.items() if v != prepared.model.nominal_value(n)}
        improved = improved_plant(plant, (), refitted, {})
    with_effects = chosen.fit.values if selection.named else nominal_refit
    values: dict[str, Setting] = {"nominal": {}, "refit": nominal_refit, "with_effects": with_effects}
    location = attribute_gap(plant, log, prepared.noise)
    gap = {model: held_out.gap(setting) for model, setting in values.items()}
    gap["upper_bound"] = _upper_bound(gap, location)
    causes: tuple[Cause, ...] = ()
    if selection.verdict != "outside_catalogue":
        causes = build_causes(plant, selection, scoring, known, sd, gap, log)
    verdict = selection.verdict
    if verdict in ("effect", "ambiguous"):
        told = all(set(cause.ambiguous_with) <= set(cause.why_same) for cause in causes)
        if told and only_parameters(selection.chosen.causes, plant):
            verdict = "parameters"
        elif any(cause.ambiguous_with for cause in causes):
            # Effects that are equivalent on any log make the verdict ambiguous too.
            verdict = "ambiguous"
    experiment = deciding_experiment(selection, hypotheses, prepared.noise)
    least = selection.ranked[0].deviance
    return _build_diagnosis(
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
            RankedHypothesis(tuple(map(name_of, one.label)), one.deviance - least, largest(one.held_out_gap))
            for one in selection.ranked
        ),
        location=location,
        next_experiment=experiment.words if experiment else advice(verdict, causes, plant.structure.system),
        experiment=experiment,
        improved=replace(improved, title=f"{plant.title} (diagnosis: {verdict})"),
        floor=reference.floors[1],
        rest=explanation.rest,
        nearest=related_effects(selection, scoring, reference) if verdict in ("outside_catalogue", "partly") else (),
        runs=hypotheses.objective.count.total,
    )


def _where(location: Location, causes: Sequence[Cause]) -> tuple[tuple[str, float], ...]:
    """Place -> share of the gap, the largest first.

    Places whose balances the log does not show share their part in proportion to what the causes there close.
    """
    shares = dict(location.shares)
    closed = dict.fromkeys(location.unobserved, 0.0)
    for cause in causes:
        if cause.place in closed:
            closed[cause.place] += max(cause.gap_closed or 0.0, 0.0)
    whole = sum(closed.values())
    if whole > 0.0:
        hidden = sum(shares[place] for place in closed)
        shares |= {place: hidden * part / whole for place, part in closed.items()}
    return tuple(sorted(shares.items(), key=lambda row: -row[1]))


def _upper_bound(gap: Mapping[str, Mapping[str, float]], location: Location) -> dict[str, float]:
    """Estimate of the smallest gap that any model could reach, by signal.

    The nominal gap without the share that injected unknown inputs close over the whole log, or the gap of the best
    model if that is smaller.
    """
    bound = {}
    for signal, nominal in gap["nominal"].items():
        if signal == "total":
            continue
        parts = {name: part for name, part in location.by_signal.get(signal, {}).items() if name != "gap"}
        free = nominal * float(np.sqrt(np.clip(1.0 - sum(parts.values()), 0.0, 1.0)))
        bound[signal] = min(free, *(gaps[signal] for gaps in gap.values()))
    bound["total"] = float(np.sqrt(np.mean([value**2 for value in bound.values()])))
    return bound
