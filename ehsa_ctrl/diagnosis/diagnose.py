"""Diagnose a log: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.log import Log, named
from ..identification.checks import check_log, refuse
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .causes import causes_of
from .diagnosis import MODELS, Candidate, Cause, Diagnosis
from .evidence import deviations
from .fit import Bench, Metric, Nominal, Refit, refit
from .held_out import Stretch, last_part, whole
from .improved import improved
from .judge import Judge, Judged, by_label
from .locate import Location, locate
from .ripple import ripple_of, with_angle
from .search import Search
from .signals import largest, noise_of
from .suspects import suspects
from .twin import Twin, with_every_effect, without_dry_friction
from .weigh import Weighed, weigh
from .what_next import advice, deciding_experiment, name_of

#: A log shorter than this leaves too little to fit and to hold out [s].
SHORTEST = 3.0
Watch = Callable[[str, int, int], None]
#: Priors of the plain refit are wider by this.
LOOSE = 30.0
#: Sets within this share of the nominal evidence of the best one are fitted to the end.
PROMISING = 0.1
#: Hypotheses of each size that are weighed on held-out data.
WEIGHED = 10


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
    """Where the gap between a log and the believed plant lies, what causes it, and how far it shrinks.

    Parameters
    ----------
    plant: as it is believed, linear or nonlinear, with the load that was there.
    log: see `read_plant_log`; it may lack force or pressures.
    validate: a second log that nothing is fitted to; the last third of `log` by default.
    threshold: a gap of a signal, relative to its standard deviation, from which on it matters.
    jobs: threads; all cores by default.
    watch: is told of stage, steps done and steps in all.
    check: refuse logs that `check_log` finds wrong: an exchanged sign or unit is no effect.

    Returns
    -------
    Diagnosis.

    Raises
    ------
    InputError: the log is plainly wrong or too short.
    """
    began = time.monotonic()
    if not 0.0 < threshold < 1.0:
        raise InputError(f"threshold = {threshold:g}; expected a share between 0 and 1, such as 0.03")
    logs = named([log] if validate is None else [log, validate])
    log, validate = logs[0], None if validate is None else logs[1]
    findings = _checked(plant, logs, check)
    noise = noise_of(log)
    twin = with_every_effect(plant)
    rippled = ripple_of(plant) > 0.0
    turned, kept = _turned(plant, log, validate) if rippled else (log, validate)
    if rippled:
        findings = (*findings, *(EFFECTS[n].caveat for n in plant.structure.effects if EFFECTS[n].caveat))
    bare = whole(plant, twin, turned, noise)
    gaps = bare.gap({})
    common: dict[str, Any] = {
        "plant": plant, "log": log, "threshold": threshold, "whole": gaps, "noise_sd": noise, "findings": findings,
        "provenance": versions(),
    }  # fmt: skip
    if largest(gaps) < threshold:
        _, held = _split(plant, twin, turned, kept, noise)
        nominal = held.gap({})
        return Diagnosis(
            verdict="no_gap", where=(), effects=(), gap=dict.fromkeys(MODELS, nominal),
            held_out=held.words, held_from=_held_from(held, log), values={}, simulated=_runs(bare, {"nominal": {}}),
            seconds=time.monotonic() - began, runs=2, **common,
        )  # fmt: skip
    if not rippled:
        turned, kept = _turned(plant, log, validate)
    trainlog, held = _split(plant, twin, turned, kept, noise)
    structure = plant.structure
    yields = plant.model == "nonlinear" and structure.chambers is not None and not structure.system.prescribed
    bristles = with_every_effect(plant, "lugre") if yields else None
    held = replace(held, twin=replace(held.twin, bristles=bristles))
    bare = replace(bare, twin=replace(bare.twin, log=turned, bristles=bristles))
    train = Twin(twin, trainlog, bare.twin.start, bristles)
    fitted = Stretch(train, 0, noise, "where it was fitted")
    metric = Metric.of(train, noise)
    lumped = without_dry_friction(twin)
    nominal_parameters, columns = Nominal.of(train, metric, threshold, lumped=lumped)
    bench = Bench(train, metric, nominal_parameters)
    search = Search(bench, suspects(train), columns, jobs=jobs or os.cpu_count() or 1, watch=watch)
    judge = _searched(search, fitted, held, threshold, lumped=lumped)
    judged = _judged(search, judge)
    loose = 1.0 if lumped else LOOSE
    free = refit(
        Bench(train, metric, nominal_parameters.loose(loose)), (), {},
        {name: column * loose for name, column in columns.items()}, steps=8, fresh=2,
    )  # fmt: skip
    nominal_gaps = {"fitted": fitted.gap({}), "held": held.gap({})}
    shaken = judge.shaken[0]
    expected = float(np.mean(metric.noise_squares)) + shaken.square
    weighed = weigh(judged, judge.floor, judge.most, threshold, nominal_gaps, expected, shaken.gap)
    location = locate(plant, log, noise)
    return _written(plant, weighed, search, judge, held, bare, free, location, common, began)


def _turned(plant: Plant, log: Log, validate: Log | None) -> tuple[Log, Log | None]:
    """Both logs with the shaft's angle, in one phase of a ripple."""
    turned = with_angle(plant, log)
    return turned, None if validate is None else with_angle(plant, validate, turned)


def _checked(plant: Plant, logs: Sequence[Log], check: bool) -> tuple[str, ...]:
    """Warnings on the logs; raises InputError for the first that is plainly wrong."""
    sentences = []
    for log in logs:
        for drive in plant.structure.system.drives.values():
            if drive not in log.channels:
                raise InputError(f"{log.path or 'the log'}: has no {drive}, which drives the simulation")
        findings = check_log(log, plant)
        if check:
            refuse(log, findings)
        sentences += [finding.of(log).sentence for finding in findings]
        length = float(log.time[-1] - log.time[0])
        if length < SHORTEST:
            raise InputError(
                f"{log.path or 'the log'}: lasts {length:.3g} s; a diagnosis needs at least {SHORTEST:g} s, of which "
                "a third is kept back"
            )
    return tuple(sentences)


def _split(
    plant: Plant, twin: Plant, log: Log, validate: Log | None, noise: Mapping[str, float]
) -> tuple[Log, Stretch]:
    """What is fitted, and what is held out."""
    if validate is None:
        return last_part(plant, twin, log, noise)
    return log, whole(plant, twin, validate, noise_of(validate))


def _searched(search: Search, fitted: Stretch, held: Stretch, threshold: float, *, lumped: bool) -> Judge:
    """Singles, pairs, and sets of three where the first two leave much or much is known to be missing."""
    search.respond()
    search.singles()
    if lumped:
        # So far from the nominal plant its derivatives say nothing of what is missing beside.
        search.respond(search.best()[0].values)
    search.grow(2)
    if lumped:
        search.missing()
        search.respond(search.best()[0].values)
    if lumped or _left(search):
        search.grow(3)
    return Judge(search, fitted, held, threshold, lumped=lumped)


def _left(search: Search) -> bool:
    """Whether pairs took off plainly more than singles, and plainly more than noise is left."""
    costs = [fits[0].cost if (fits := search.best(size)) else np.inf for size in (1, 2)]
    return costs[1] < 0.7 * costs[0] and search.bench.level > 1.2


def _judged(search: Search, judge: Judge) -> list[Judged]:
    """The best hypotheses of each size on what was held out; the most promising sets are first fitted to the end."""

    def best() -> list[Refit]:
        return [search.fits[()], *(fit for size in (1, 2, 3) for fit in search.best(size)[:WEIGHED])]

    first = sorted(by_label([judge.judge(fit) for fit in best()]).values(), key=lambda j: j.evidence)
    within = first[0].evidence + PROMISING * abs(judge.weigh(search.residual))
    promising = [j for j in first[:4] if j.evidence <= within]
    search.finish([j.fit for j in promising], steps=8)
    judged = [judge.judge(fit) for fit in best()]
    if not any(np.isfinite(j.evidence) for j in judged):
        raise InputError(
            f"{judge.held.twin.log.path or 'the log'}: neither the believed plant nor any refit of it can be simulated "
            "over what is held out; check units and signs (compare shows both side by side) and the plant's parameters"
        )
    return judged


def _written(
    plant: Plant,
    weighed: Weighed,
    search: Search,
    judge: Judge,
    held: Stretch,
    bare: Stretch,
    free: Refit | None,
    location: Location,
    common: Mapping[str, Any],
    began: float,
) -> Diagnosis:
    """The result, from what was weighed."""
    chosen = weighed.chosen
    named = weighed.verdict in ("effect", "ambiguous")
    values = {"nominal": {}, "refit": free.values if free is not None else {}, "with_effects": chosen.fit.values}
    if not named:
        values["with_effects"] = values["refit"]
    gap = {model: held.gap(setting) for model, setting in values.items()}
    gap["upper_bound"] = _bound(gap, location)
    sd = deviations(chosen.fit, judge.worth)
    causes = causes_of(plant, weighed, judge, sd, gap, common["log"]) if weighed.verdict != "outside_catalogue" else ()
    # What no log can tell apart makes a set too.
    verdict = "ambiguous" if weighed.verdict == "effect" and any(c.ambiguous_with for c in causes) else weighed.verdict
    following = deciding_experiment(weighed, search, common["noise_sd"])
    changed = {n: v for n, v in chosen.fit.values.items() if v != _nominal_value(judge, n)}
    caveats = [EFFECTS[id].caveat for id, _ in chosen.causes if named]
    findings = tuple(dict.fromkeys([*common["findings"], *filter(None, caveats)]))
    common = {**common, "findings": findings}
    return Diagnosis(
        verdict=verdict,
        where=_where(location, causes),
        effects=causes,
        gap=gap,
        held_out=held.words,
        held_from=_held_from(held, common["log"]),
        values=values,
        simulated=_runs(bare, values),
        candidates=tuple(
            Candidate(tuple(name_of(key) for key in j.label), j.evidence - weighed.labels[0].evidence, largest(j.held))
            for j in weighed.labels
        ),
        location=location,
        next_experiment=following.words if following is not None else advice(verdict, causes, plant.structure.system),
        experiment=following,
        improved=improved(plant, chosen.fit.suspects, changed, sd) if named else None,
        seconds=time.monotonic() - began,
        runs=search.bench.runs,
        **common,
    )


def _where(location: Location, causes: Sequence[Cause]) -> tuple[tuple[str, float], ...]:
    """Shares of the places. What lies in places whose balances no sensor shows lies where their causes act."""
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


def _held_from(held: Stretch, log: Log) -> float | None:
    """Where in the log the held-out part begins [s]; None if it is another log."""
    own = held.twin.log
    return float(own.time[held.first]) if own.path == log.path and held.first > 0 else None


def _bound(gap: Mapping[str, Mapping[str, float]], location: Location) -> dict[str, float]:
    """What a model of any form could reach: the nominal gap less what free unknown inputs take of it, or the best.

    The parts that unknown inputs take are those over the whole log.
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


def _nominal_value(judge: Judge, name: str) -> float:
    """What a symbol or a sensor's word is without the hypothesis."""
    plant = judge.search.bench.twin.plant
    if name in plant.parameters:
        return plant[name]
    word, _, channel = name.partition(".")
    return getattr(plant.sensors[channel], word) if word in ("bias", "scale") else 0.0


def _runs(bare: Stretch, values: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, np.ndarray]]:
    """Free runs over the whole log, those that last."""
    found = {model: bare.simulate(setting) for model, setting in values.items()}
    return {model: run for model, run in found.items() if run is not None}
