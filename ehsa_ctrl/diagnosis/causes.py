"""The causes as reported: parameters, shares of the gap, and effects that explain the log as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np

from ..core.log import Log
from ..physics.effects import EFFECTS
from ..plant.plant import Plant, sensor_unit
from .acting_model import law_switches
from .diagnosis import Cause, CauseParameter, RelatedEffect
from .hypothesis_model import is_applicable
from .model_selection import Reference, Selection
from .own_offsets import IN_LOG, log_of, shared_name
from .scoring import CauseKey, ScoredHypothesis, Scoring
from .signals import largest

#: Candidates below this probability are not listed. Engineering judgement.
MIN_PROBABILITY = 0.02
#: Hypotheses whose effects are listed as near to what stays unexplained.
NEAREST = 3
#: Logistic regression of whether a listed cause is right, on 210 listed causes of tuning seeds of the bench:
#: constant, logarithm of its own gap, logarithm of the gap that is left. Gaps are in thresholds and within SMALLEST and
#: LARGEST, their range there. Whether the verdict is `partly` tells no more: it is where much is left.
RELIABILITY, SMALLEST, LARGEST = (-0.55, 1.23, -1.36), 0.05, 20.0
#: The Shapley value is exact for so many causes, and the mean over so many random orders for more.
MAX_EXACT, ORDERS = 5, 40


def build_causes(
    plant: Plant,
    selection: Selection,
    scoring: Scoring,
    known: Sequence[ScoredHypothesis],
    sd: Mapping[str, float],
    gap: Mapping[str, Mapping[str, float]],
    logs: Sequence[Log],
) -> tuple[Cause, ...]:
    """Causes of the chosen hypothesis, the largest first, and the other candidates if the verdict is underdetermined.

    known: all hypotheses that were scored. sd: standard deviation of each parameter of the chosen hypothesis.
    gap: model -> signal -> gap on held-out data.
    """
    chosen = selection.chosen
    closed = _closed_shares(selection, scoring, known, gap["nominal"]["total"])
    nominal, refitted, final = (gap[m]["total"] for m in ("nominal", "refit", "with_effects"))
    absorbed = float(np.clip((nominal - refitted) / (nominal - final), 0.0, 1.0)) if nominal > final else 0.0
    found = []
    for key in chosen.causes:
        equivalent = _equivalent_effects(key[0], chosen.fit.values, plant, logs)
        # A sensor error of another channel has the same id.
        others = (other for other, _ in selection.alternatives.get(key, ()))
        found.append(
            Cause(
                id=key[0],
                channel=key[1],
                place=plant.structure.system.place_of(EFFECTS[key[0]].place),
                probability=reliability(
                    largest(chosen.own_gaps[key]) / scoring.threshold,
                    final / scoring.threshold,
                ),
                parameters=_parameters(key, chosen, scoring, sd),
                ambiguous_with=tuple(dict.fromkeys([*equivalent, *others])),
                absorbed_by_refit=absorbed,
                gap_closed=closed.get(key, 0.0),
                alone=chosen.own_gaps[key],
                why_same=equivalent,
            )
        )
    found.sort(key=lambda cause: -largest(cause.alone))
    if selection.verdict == "underdetermined":
        found += _further_candidates(selection, scoring)
    return tuple(found)


def reliability(size: float, left: float) -> float:
    """Probability that a claimed cause, or one that could replace it, is present.

    How often a claimed cause of such a size is right where the model leaves so much comes from logs whose truth is
    known, see RELIABILITY. The share of the cause among the hypotheses says nothing beyond it (its coefficient in the
    same regression is 0.05): the hypotheses know nothing of effects that they lack. size: gap that the cause makes.
    left: gap in total that the model leaves. Both in thresholds.
    """
    constant, by_size, by_left = RELIABILITY
    # Beyond the range of those logs, what is left counts relative to the cause.
    beyond = max(size / LARGEST, 1.0)
    size, left = np.clip([size / beyond, left / beyond], SMALLEST, LARGEST)
    logit = constant + by_size * np.log(size) + by_left * np.log(left)
    return float(1.0 / (1.0 + np.exp(-logit)))


def related_effects(selection: Selection, scoring: Scoring, reference: Reference) -> tuple[RelatedEffect, ...]:
    """Effects of the nearest hypotheses that are not claimed, each with what its hypothesis closes; the best first."""
    claimed = selection.chosen.causes if selection.named else ()
    found: dict[CauseKey, RelatedEffect] = {}
    for scored in selection.ranked[:NEAREST]:
        closed = reference.closed(scored)[1]
        sd = scoring.standard_deviations(scored.fit)
        for key in scored.causes:
            if key not in claimed and closed > 0.0 and (key not in found or closed > found[key].gap_closed):
                found[key] = RelatedEffect(*key, closed, _parameters(key, scored, scoring, sd))
    return tuple(sorted(found.values(), key=lambda one: -one.gap_closed))


def _equivalent_effects(id: str, values: Mapping[str, float], plant: Plant, logs: Sequence[Log]) -> Mapping[str, str]:
    """Effects of the plant that are equivalent to this one on any log: id -> reason."""
    equivalent = EFFECTS[id].equivalent_effects
    if equivalent is None:
        return {}
    slopes = [one.channel for one in plant.structure.system.scored if one.span]
    steps = [np.diff(log[channel]) / log.sample_time for log in logs for channel in slopes if channel in log.channels]
    speed = max((float(np.max(np.abs(step))) for step in steps), default=0.0)
    found = equivalent(values, plant.values, speed)
    return {
        other: why for other, why in found.items() if not EFFECTS[other].wired or is_applicable(plant.structure, other)
    }


def _further_candidates(selection: Selection, scoring: Scoring) -> list[Cause]:
    """Candidates that were not chosen, the most probable first, each with the parameters of its best hypothesis."""
    found: dict[CauseKey, Cause] = {}
    for scored in selection.ranked:
        for key in scored.causes:
            p = selection.probability.get(key, 0.0)
            if key in selection.chosen.causes or key in found or p < MIN_PROBABILITY:
                continue
            parameters = _parameters(key, scored, scoring, scoring.standard_deviations(scored.fit))
            place = scoring.objective.model.plant.structure.system.place_of(EFFECTS[key[0]].place)
            found[key] = Cause(key[0], key[1], place, min(p, 1.0), parameters, alone=scored.own_gaps[key])
    return sorted(found.values(), key=lambda cause: -cause.probability)


def _parameters(
    key: CauseKey, scored: ScoredHypothesis, scoring: Scoring, sd: Mapping[str, float]
) -> dict[str, CauseParameter]:
    """Name -> estimated parameter of a cause; that of a sensor is called `value`, because the cause has the channel.

    A number that acts in one log alone has the log in its name, as in `own_offsets`.
    """
    model, values = scoring.objective.model, scored.fit.values
    kinds = {
        kind.name: kind.unit
        for p in (model.plant, *model.plants_by_law.values())
        for kind in p.structure.equations.parameters
    }
    switches = {switch.number: switch for switch in law_switches()}
    ids = scoring.ids
    out = {}
    for free in (free for c in scored.fit.candidates if c.key == key for free in c.free):
        name = free.name
        if ids.get(name, key[0]) != key[0]:
            continue
        deviation = 0.0 if free.fixed else sd.get(name, np.nan)
        base, log = shared_name(name), log_of(name)
        within = f"{IN_LOG}{log}" if log else ""
        if name in switches:
            switch = switches[name]
            number = max(values[name], switch.threshold)
            out[switch.reported] = CauseParameter(1.0 / number, deviation / number**2, kinds[switch.parameter])
        elif "." not in base:
            out[name] = CauseParameter(values[name], deviation, kinds[base])
        elif key[1] is not None:
            out[f"value{within}"] = CauseParameter(values[name], deviation, sensor_unit(base))
    for f in scored.fit.free:
        if (ids.get(f.name), None) == key and f.name not in out:
            out[f.name] = CauseParameter(values[f.name], sd.get(f.name, f.scale), kinds[f.name])
    return out


def _closed_shares(
    selection: Selection, scoring: Scoring, known: Sequence[ScoredHypothesis], nominal: float
) -> dict[CauseKey, float]:
    """Share of the total gap that each cause closes: its Shapley value, see gap_attribution."""
    chosen = selection.chosen
    causes = chosen.causes
    if nominal == 0.0:
        return dict.fromkeys(causes, 0.0)
    gaps: dict[frozenset[CauseKey], float] = {frozenset(): nominal, frozenset(causes): chosen.held_out_gap["total"]}
    for scored in known:
        part = frozenset(scored.causes)
        if part < frozenset(causes) and part:
            gaps[part] = min(gaps.get(part, np.inf), scored.held_out_gap["total"])

    def left(members: frozenset[CauseKey]) -> float:
        if members not in gaps:
            removed = {n for c in chosen.fit.candidates if c.key not in members for n in c.names}
            gaps[members] = scoring.held_out.gap({n: v for n, v in chosen.fit.values.items() if n not in removed})[
                "total"
            ]
        return min(gaps[members], nominal * 10.0)

    out = dict.fromkeys(causes, 0.0)
    if len(causes) <= MAX_EXACT:
        orders = list(permutations(causes))
    else:
        # The mean over random orders estimates the value (J. Castro et al., Computers & Operations Research 36, 2009).
        random = np.random.default_rng(0)
        orders = [tuple(causes[i] for i in random.permutation(len(causes))) for _ in range(ORDERS)]
    for order in orders:
        for i, key in enumerate(order):
            out[key] += (left(frozenset(order[:i])) - left(frozenset(order[: i + 1]))) / nominal / len(orders)
    return out
