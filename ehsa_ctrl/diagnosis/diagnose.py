"""The stages of a diagnosis.

    PreparedLogs -> Segments -> Hypotheses -> Scoring, Selection -> Diagnosis

Each stage is an immutable object; the functions below compute it from the previous ones.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..core.log import Log
from ..core.parallel import one_blas_thread
from ..core.text import join_words
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from ..simulation.threads import sharing_threads
from ..simulation.trajectory import versions
from .absorbed_parameters import with_absorbed_parameters, with_determined_parameters
from .causes import build_causes, related_effects
from .diagnosis import MODELS, Cause, Diagnosis, LogGap, RankedHypothesis
from .explanation import Explanation, claimable_part, explain, only_parameters
from .folds import Fold, folds_of, uneven_folds
from .free_curve import CurveLog
from .gap_attribution import Location, attribute_gap
from .hypothesis_model import (
    Setting,
    lacks_dry_friction,
)
from .hypothesis_search import Hypotheses, search
from .improved_plant import improved_plant
from .law.experiment import form_experiment
from .law.find import find_law, law_is_sought
from .law.found import FoundLaw, without_imitators
from .law.free_run import with_effect
from .law.tried import LawBase, LawData
from .model_selection import Reference, Selection, select_model
from .next_experiment import deciding_experiment
from .objective import objective_of
from .pool import Pool, Watch
from .prepared_logs import (
    PreparedLogs,
    Segments,
    curve_logs,
    left_out,
    one_sided_gap,
    prepare_logs,
    segment_candidates,
    split_logs,
    unmoved_signals,
)
from .pruning import prune
from .records import Runs, Segment, joint_gap
from .refit import HypothesisFit, refit_nominal
from .scoring import (
    ScoredHypothesis,
    Scoring,
    effect_id_by_parameter,
    floor_of,
    input_noise_gaps,
    score_hypotheses,
)
from .second_search import search_from_selection
from .several_parameters import may_be_several, with_several_parameters
from .signals import largest
from .sizes import of_causes, with_sizes
from .stretch import search_segment
from .together import joint_location
from .validation_segment import windows_of
from .verdict_text import advice, name_of

#: Shares of the computing time, for its display: search, several nominal parameters, and the end of the scores.
#: Measured on logs of 24 s, and on logs of 400 and 570 s that are searched in a stretch.
SHARES, SHARES_OF_STRETCH = (0.35, 0.25, 0.8), (0.1, 0.1, 0.75)
#: Factor on the prior deviations when only nominal parameters are refitted. Engineering judgement: practically no
#: prior, so that the refit shows the most that wrong parameters can explain.
REFIT_PRIOR_FACTOR = 30.0


@one_blas_thread()
def diagnose(
    plant: Plant,
    log: Log | Sequence[Log],
    *,
    validate: Log | None = None,
    threshold: float = 0.03,
    jobs: int | None = None,
    watch: Watch | None = None,
    check: bool = True,
    without: Collection[str] = (),
) -> Diagnosis:
    """Find where a log differs from the nominal plant, which effect is the cause, and how much of the gap it closes.

    Parameters
    ----------
    plant: nominal plant, linear or nonlinear, with the load of the experiment.
    log: measured log, see `read_plant_log`; force and pressures may be missing. Several logs of one rig are diagnosed
        together: causes and nominal parameters are shared; the initial state is each log's own, and offsets of sensors
        and of the current are where that explains more. `Log.settings` holds what was set for one of them, such as the
        stiffness of a spring.
    validate: second log for validation; by default a third of each log is held out, see `split`.
    threshold: smallest relevant gap of a signal, as a share of its standard deviation.
    jobs: number of threads; all cores by default.
    watch: progress callback, called with the current stage, and steps done and total steps of the whole diagnosis.
    check: reject a log in which `check_log` finds an error: a wrong sign or unit is not an effect.
    without: ids of effects that are left out of the catalogue.

    Returns
    -------
    Diagnosis.

    Raises
    ------
    InputError: a log has an error, lasts less than SHORTEST, lacks the channel of the drive or stands still; no model
        can be simulated on it; logs differ in sample time or channels, or one is given twice; threshold is not
        between 0 and 1; or `without` names no effect.
    """
    began = time.monotonic()
    logs = [log] if isinstance(log, Log) else list(log)
    prepared = prepare_logs(plant, logs, validate, threshold, check=check)
    whole = Segment(tuple(one.record for one in prepared.logs), join_words(one.log.name for one in prepared.logs))
    nominal = whole.simulate({})
    own_gaps = [record.gap(run) for record, run in zip(whole.records, nominal, strict=True)] if nominal else []
    gaps = joint_gap(own_gaps) if own_gaps else whole.gap_of(None)
    small = bool(own_gaps) and all(largest(own) < threshold for own in own_gaps)
    segments = split_logs(prepared, whole, has_gap=not small)
    findings = (*prepared.findings, *left_out(without), *unmoved_signals(segments))
    prepared = replace(prepared, findings=findings)
    if small:
        gap = dict.fromkeys(MODELS, segments.held_out.gap({}))
        floor = floor_of(segments.held_out, input_noise_gaps(segments.held_out, {}))
        return _build_diagnosis(
            prepared, segments, gaps, {}, began, verdict="no_gap", where=(), effects=(), gap=gap, floor=floor, runs=2
        )
    with sharing_threads(jobs or os.cpu_count() or 1):
        return _diagnose_gap(prepared, segments, gaps, own_gaps, without, watch, began)


def _diagnose_gap(
    prepared: PreparedLogs,
    segments: Segments,
    gaps: Mapping[str, float],
    own_gaps: Sequence[Mapping[str, float]],
    without: Collection[str],
    watch: Watch | None,
    began: float,
) -> Diagnosis:
    """The result where there is a gap: search, selection, sizes.

    gaps, own_gaps, began: see `_diagnose_selection`. without, watch: see `diagnose`.
    """
    threshold = prepared.threshold
    objective, sensitivities = objective_of(segments.training, threshold)
    lumped = lacks_dry_friction(prepared.model.plant)
    pool = Pool(watch)
    plants = [one.plant for one in prepared.logs]
    searched = segments.searched
    all_data = searched is segments.training
    shares = SHARES if all_data else SHARES_OF_STRETCH
    pool.progress.begin(shares[0])
    problem = (objective, sensitivities) if all_data else objective_of(searched, threshold)
    hypotheses = Hypotheses.initial(problem[0], segment_candidates(segments.training, without), problem[1], pool)
    hypotheses, screening = search(hypotheses, lumped=lumped)
    if not lumped and may_be_several(hypotheses):
        ids = effect_id_by_parameter(prepared.model.plant)
        pool.progress.begin(shares[1])
        hypotheses = with_several_parameters(hypotheses, screening, ids, threshold)
    pool.progress.begin(shares[2] - pool.progress.end)
    if not all_data:
        hypotheses = hypotheses.on_all_data(objective, sensitivities)
        words = f"effects were searched {searched.name}; the best were refitted to all training data and scored on it"
        prepared = replace(prepared, findings=(*prepared.findings, words))
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, threshold, lumped=lumped)
    windows = windows_of(plants, searched)
    hypotheses, scores, superseded = score_hypotheses(
        hypotheses, scoring, windows if all_data else None, windows or searched
    )
    reference = Reference.of(scoring)
    selection = select_model(scores, reference)
    if not lumped:
        selection, hypotheses, scores = prune(selection, scores, hypotheses, scoring, reference)
        if all_data:
            # After a search on a stretch, its refits to all training data took 70 of 175 s on a log of 400 s.
            selection, hypotheses, scores = search_from_selection(
                selection, scores, hypotheses, scoring, reference, windows or searched
            )
    pool.progress.begin(1.0 - pool.progress.end)
    pool.progress.report("sizes", 0.0)
    selection, hypotheses = with_absorbed_parameters(selection, hypotheses, scoring, reference)
    selection, sd = with_sizes(selection, scoring)
    selection = with_determined_parameters(selection, sd, scoring)
    sd = of_causes(selection, scoring, sd)
    pool.progress.report("place of the gap", 1.0)
    nominal_refit = refit_nominal(objective, sensitivities, 1.0 if lumped else REFIT_PRIOR_FACTOR)
    known = [*superseded, *scores]
    return _diagnose_selection(
        prepared, segments, gaps, own_gaps, hypotheses, scoring, reference, selection, sd, known, nominal_refit, began
    )


def _build_diagnosis(
    prepared: PreparedLogs,
    segments: Segments,
    gaps: Mapping[str, float],
    values: Mapping[str, Setting],
    began: float,
    locations: Sequence[Location] = (),
    findings: Sequence[str] = (),
    **found: Any,
) -> Diagnosis:
    """The result, with the fields that do not depend on the verdict; `found` holds the others.

    gaps: of the nominal plant over the whole log. values: model -> setting, for its free run over the whole log. began:
    start of the computation by the monotonic clock [s]. locations: of each log, if there is a gap.
    """
    simulated = {model: segments.whole.simulate(setting) for model, setting in {"nominal": {}, **values}.items()}
    runs = {model: run for model, run in simulated.items() if run is not None}
    logs = _log_gaps(prepared, segments, values, runs, locations)
    return Diagnosis(
        plant=prepared.plant,
        log=prepared.logs[0].log,
        threshold=prepared.threshold,
        whole=gaps,
        held_out=segments.held_out.name,
        held_spans=logs[0].held_spans,
        noise_sd=prepared.noise,
        values=values,
        simulated=logs[0].simulated,
        logs=logs if len(logs) > 1 else (),
        findings=tuple(dict.fromkeys([*prepared.findings, *findings])),
        seconds=time.monotonic() - began,
        provenance=versions(),
        **found,
    )


def _log_gaps(
    prepared: PreparedLogs,
    segments: Segments,
    values: Mapping[str, Setting],
    runs: Mapping[str, Runs],
    locations: Sequence[Location],
) -> tuple[LogGap, ...]:
    """The figures of each log. runs: model -> free run over each whole log."""
    # With a second log for validation, the logs are whole in the training data.
    scored = segments.held_out if segments.splits is not None else segments.whole
    simulated = {model: scored.simulate(setting) for model, setting in {"nominal": {}, **values}.items()}
    found = []
    for i, one in enumerate(prepared.logs):
        record = scored.records[i]
        gap = {
            model: dict.fromkeys([*record.measured, "total"], float("inf")) if run is None else record.gap(run[i])
            for model, run in simulated.items()
        }
        gap |= {"upper_bound": upper_bound(gap, locations[i])} if locations else dict.fromkeys(MODELS, gap["nominal"])
        split = segments.splits[i] if segments.splits is not None else None
        found.append(
            LogGap(
                log=one.log,
                gap=gap,
                whole=segments.whole.records[i].gap(runs["nominal"][i]) if "nominal" in runs else gap["nominal"],
                noise_sd=one.noise,
                held_out=split.words(one.model.log) if split is not None else "none, all of it was fitted",
                held_spans=split.spans(one.model.log) if split is not None else (),
                simulated={model: run[i] for model, run in runs.items()},
            )
        )
    return tuple(found)


def _diagnose_selection(
    prepared: PreparedLogs,
    segments: Segments,
    gaps: Mapping[str, float],
    own_gaps: Sequence[Mapping[str, float]],
    hypotheses: Hypotheses,
    scoring: Scoring,
    reference: Reference,
    selection: Selection,
    sd: Mapping[str, float],
    known: Sequence[ScoredHypothesis],
    nominal_refit: Setting,
    began: float,
) -> Diagnosis:
    """The result where there is a gap.

    own_gaps: of the nominal model over each whole log, empty if its run stopped. sd: standard deviation of each
    parameter of the causes. known: all hypotheses that were scored. nominal_refit: nominal parameters refitted without
    any effect.
    """
    plant = prepared.plant

    def with_causes_of(fit: HypothesisFit, sd: Mapping[str, float]) -> tuple[Plant, list[CurveLog]]:
        changed = {n: v for n, v in fit.values.items() if v != prepared.model.nominal_value(n)}
        improved = improved_plant(plant, fit.candidates, changed, sd)
        return improved, curve_logs(prepared, segments, improved, fit)

    def explained(selection: Selection, sd: Mapping[str, float]) -> tuple[Plant, Explanation]:
        improved, logs = with_causes_of(selection.chosen.fit, sd)
        return improved, explain(selection, reference, prepared.threshold, logs)

    improved, explanation = explained(selection, sd)
    if explanation.verdict == "outside_catalogue" and (part := claimable_part(selection, reference)) is not None:
        selection, sd = with_sizes(part, scoring)
        sd = of_causes(selection, scoring, sd)
        improved, explanation = explained(selection, sd)
        explanation = replace(explanation, verdict="partly")
    selection = replace(selection, verdict=explanation.verdict)
    law, selection = _law(
        prepared, segments, hypotheses, scoring, reference, selection, logs_with=lambda fit: with_causes_of(fit, {})[1]
    )
    if law is not None:
        improved, _ = with_causes_of(selection.chosen.fit, sd)
    chosen = selection.chosen
    if not selection.named:
        refitted = {n: v for n, v in nominal_refit.items() if v != prepared.model.nominal_value(n)}
        improved = improved_plant(plant, (), refitted, {})
    with_effects = chosen.fit.values if selection.named else nominal_refit
    values: dict[str, Setting] = {"nominal": {}, "refit": nominal_refit, "with_effects": with_effects}
    locations = [attribute_gap(one.plant, one.log, one.noise) for one in prepared.logs]
    location = joint_location(
        {one.log.name: place for one, place in zip(prepared.logs, locations, strict=True)},
        [own["total"] for own in own_gaps] or [1.0] * len(locations),
    )
    with_causes = improved if law is not None else None
    if law is not None:
        segments = segments.each(partial(with_effect, effect=law.effect, begin=law.begin))
        values["with_law"] = {n: v for n, v in law.values.items() if v != prepared.model.nominal_value(n)}
        improved = improved_plant(plant, law.candidates, values["with_law"], law.sd)
    gap = {model: segments.held_out.gap(setting) for model, setting in values.items()}
    gap["upper_bound"] = upper_bound(gap, location)
    causes: tuple[Cause, ...] = ()
    if selection.verdict != "outside_catalogue":
        causes = build_causes(plant, selection, scoring, known, sd, gap, [one.log for one in prepared.logs])
    verdict = selection.verdict
    if verdict in ("effect", "ambiguous"):
        told = all(set(cause.ambiguous_with) <= set(cause.why_same) for cause in causes)
        if told and only_parameters(selection.chosen.causes, plant):
            verdict = "parameters"
        elif any(cause.ambiguous_with for cause in causes):
            # Effects that are equivalent on any log make the verdict ambiguous too.
            verdict = "ambiguous"
    experiment = deciding_experiment(selection, hypotheses, prepared.noise)
    todo = advice(
        verdict,
        causes,
        plant.structure.system,
        [one.log for one in prepared.logs],
        has_law=law is not None,
        has_curve=explanation.rest is not None,
    )
    if law is not None:
        experiment = form_experiment(law, hypotheses.objective, prepared.noise)
    least = selection.ranked[0].deviance
    folds: tuple[Fold, ...] = ()
    if selection.named and law is None:
        folds = folds_of(prepared, segments, scoring.objective, chosen.fit, hypotheses.pool)
    return _build_diagnosis(
        prepared,
        segments,
        gaps,
        values,
        began,
        locations,
        findings=[
            *(EFFECTS[id].caveat for id, _ in chosen.causes if selection.named and EFFECTS[id].caveat),
            *one_sided_gap(segments, prepared.threshold),
            *uneven_folds(folds, prepared.threshold),
            *(law.caveats if law is not None else ()),
        ],
        verdict=verdict,
        where=_where(location, causes),
        effects=causes,
        gap=gap,
        candidates=tuple(
            RankedHypothesis(tuple(map(name_of, one.label)), one.deviance - least, largest(one.held_out_gap))
            for one in selection.ranked
        ),
        location=location,
        next_experiment=experiment.words if experiment else todo,
        experiment=experiment,
        improved=replace(improved, title=f"{plant.title} (diagnosis: {verdict})"),
        floor=reference.floors[1],
        folds=folds,
        rest=explanation.rest,
        law=None if law is None else law.proposed,
        with_causes=with_causes,
        nearest=related_effects(selection, scoring, reference) if verdict in ("outside_catalogue", "partly") else (),
        runs=hypotheses.objective.count.total,
    )


def _law(
    prepared: PreparedLogs,
    segments: Segments,
    hypotheses: Hypotheses,
    scoring: Scoring,
    reference: Reference,
    selection: Selection,
    logs_with: Callable[[HypothesisFit], Sequence[CurveLog]],
) -> tuple[FoundLaw | None, Selection]:
    """The law of what no effect of the catalogue explains, and the selection without the causes that imitate it.

    logs_with: the logs with the plant that has the effects of a fit.
    """
    if not law_is_sought(selection, reference):
        return None, selection

    def base_of(fit: HypothesisFit) -> LawBase:
        logs = logs_with(fit) if fit.candidates else curve_logs(prepared, segments, prepared.plant)
        return LawBase(logs, fit)

    data = LawData(base_of, replace(scoring, windows=segments.windows(prepared)), reference)
    stretch = _stretch(prepared, segments, hypotheses, data)
    law = find_law(hypotheses, selection, data, stretch)
    if law is None:
        return None, selection
    others = without_imitators(selection, law, reference)
    if others is selection and selection.explains:
        # What causes leave that explain the gap does not matter.
        return None, selection
    return law, others


def _stretch(prepared: PreparedLogs, segments: Segments, hypotheses: Hypotheses, data: LawData) -> LawData | None:
    """The stretches of long logs in which laws are searched; None for short logs, where the nominal plant can't be
    simulated on them, and with a second log for validation, in the middle of which a law's memory is not known.
    """
    if segments.searched is segments.training or prepared.validation is not None:
        return None
    held_out = search_segment(prepared.held_out_plants, segments.held_out)
    scoring = data.scoring.on(segments.searched, held_out, hypotheses.best()[0].values)
    if scoring is None:
        return None
    searched = segments.searched_samples(prepared)

    def base_of(fit: HypothesisFit) -> LawBase:
        base = data.base_of(fit)
        pairs = zip(base.logs, searched, strict=True)
        return replace(base, logs=[replace(one, training=part) for one, part in pairs])

    return LawData(base_of, scoring, Reference.of(scoring))


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


def upper_bound(gap: Mapping[str, Mapping[str, float]], location: Location) -> dict[str, float]:
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
