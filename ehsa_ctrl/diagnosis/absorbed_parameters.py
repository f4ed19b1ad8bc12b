"""Wrong nominal parameters that a refit hides beside the causes.

Every hypothesis refits all nominal parameters, each within its prior. Many small changes may together close what a
cause should: the causes are therefore fitted once more with all other parameters at their nominal values. A single
parameter is wrong, too, if its final value is clearly another one and the difference makes a gap that matters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from .candidate_effects import with_parameters
from .hypothesis_model import Setting
from .hypothesis_search import Hypotheses, Task
from .local_search import MAX_CAUSES
from .model_selection import Reference, Selection, dominates, selection_of
from .objective import NominalParameters
from .refit import refit_until_converged
from .scoring import CauseKey, ScoredHypothesis, Scoring, exact_members
from .signals import largest, largest_beyond

#: Parameters that a refit hides beside the causes. Engineering judgement: with more of them a form is wrong.
MAX_ABSORBED = 2
#: Other sets of causes that are tried in the place of causes with hidden parameters. Engineering judgement.
RIVALS = 3
#: A parameter is clearly another one if its final value differs by so many standard deviations from the nominal one. On
#: the tuning seeds, values that differed by more and made a gap were wrong in four cases of four, those between 1.5 and
#: 3 in none of six.
CLEARLY = 3.0


def with_absorbed_parameters(
    selection: Selection, hypotheses: Hypotheses, scoring: Scoring, reference: Reference
) -> tuple[Selection, Hypotheses]:
    """The selection with those wrong nominal parameters as causes that its refit would hide.

    The causes are fitted with all other parameters at their nominal values. While that leaves a gap of the threshold
    or more beyond the floor on the training data, the parameter is added that closes most of it; where it takes more
    than MAX_ABSORBED, the form of a cause is wrong rather than the parameters. Added parameters are as probable as the
    least probable cause. A set with no more causes than there are then takes their place if it fits better and hides
    nothing.
    """
    if scoring.lumped or not selection.chosen.causes:
        return selection, hypotheses
    chosen = selection.chosen

    def left(values: Setting) -> float:
        # On held-out data a single slip may decide: what the training data does not ask for is no cause.
        return largest_beyond(scoring.training.gap(values), reference.floors[0])

    def hides_nothing(one: ScoredHypothesis) -> bool:
        return left(_alone(one, hypotheses, scoring)) < reference.threshold

    if hides_nothing(chosen):
        return selection, hypotheses
    added, rest = _hidden(chosen, scoring, left)
    if not added or rest >= reference.threshold:
        return selection, hypotheses
    ids, values = scoring.ids, chosen.fit.values
    members = with_parameters(
        [c for c in chosen.fit.candidates if c.key in chosen.causes],
        [n for n in values if ids.get(n) in {id for id, _ in (*chosen.causes, *added)}],
        hypotheses.candidates,
        ids,
    )
    task = Task(members, values)
    hypotheses = hypotheses.with_refits([task], "sets of causes", steps=6, renew_after=1)
    refitted = next((scoring.score(fit) for fit in hypotheses.fits_of([task])), chosen)
    best = min(chosen, refitted, key=lambda one: one.deviance)
    rivals = [
        one
        for one in selection.ranked
        if one.causes
        and one.deviance < best.deviance
        and len(one.causes) <= len(chosen.causes) + len(added)
        and not dominates(chosen, one, reference)
    ]
    for rival in rivals[:RIVALS]:
        if hides_nothing(rival):
            return selection_of(rival, selection.ranked, reference), hypotheses
    least = min((selection.probability.get(key, 0.0) for key in chosen.causes), default=1.0)
    added = {key: names for key, names in added.items() if best is chosen or key not in best.causes}
    own = {**best.own_gaps, **scoring.changes_of(best.fit.values, added)}
    best = replace(best, causes=(*best.causes, *added), own_gaps=own)
    probability = {**dict.fromkeys(best.causes, least), **selection.probability}
    return replace(selection, chosen=best, probability=probability), hypotheses


def with_determined_parameters(selection: Selection, sd: Mapping[str, float], scoring: Scoring) -> Selection:
    """The selection with those nominal parameters as causes whose final values are clearly other than the nominal ones,
    see CLEARLY, and whose differences alone make a gap of the threshold.

    sd: standard deviation of each number of the final fit. A parameter's probability is that of the difference being
    large enough for that, and at most that of the least probable cause.
    """
    chosen = selection.chosen
    if scoring.lumped or not chosen.causes:
        return selection
    values, nominal = chosen.fit.values, {f.name: f.nominal for f in chosen.fit.free}
    moved = {n: abs(values[n] - nominal[n]) / sd[n] for n in nominal if sd.get(n)}
    _, others = _beside(chosen, scoring.ids)
    clearly = {key: {n for n in names if moved.get(n, 0.0) > CLEARLY} for key, names in others.items()}
    members = {key: names for key, names in clearly.items() if names}
    least = min((selection.probability.get(key, 0.0) for key in chosen.causes), default=1.0)
    limit = scoring.threshold
    own_gaps, probability = dict(chosen.own_gaps), dict(selection.probability)
    added: list[CauseKey] = []
    for key, gaps in scoring.changes_of(values, members).items():
        if largest(gaps) >= limit and len(chosen.causes) + len(added) < MAX_CAUSES:
            added.append(key)
            own_gaps[key] = gaps
            distance = max(moved[name] for name in members[key])
            probability[key] = min(least, float(norm.cdf(distance * (1.0 - limit / largest(gaps)))))
    chosen = replace(chosen, causes=(*chosen.causes, *added), own_gaps=own_gaps)
    return replace(selection, chosen=chosen, probability=probability)


def _beside(chosen: ScoredHypothesis, ids: Mapping[str, str]) -> tuple[set[str], dict[CauseKey, set[str]]]:
    """The numbers of the causes, and the nominal parameters that are refitted beside them, by the effect that stands
    for them."""
    of_causes = {n for c in chosen.fit.candidates for n in c.names}
    of_causes |= {n for n in chosen.fit.values if (ids.get(n), None) in chosen.causes}
    others: dict[CauseKey, set[str]] = {}
    for f in chosen.fit.free[chosen.fit.n_effect :]:
        if f.name in ids and f.name not in of_causes:
            others.setdefault((ids[f.name], None), set()).add(f.name)
    return of_causes, others


def _alone(one: ScoredHypothesis, hypotheses: Hypotheses, scoring: Scoring) -> Setting:
    """The values of a set of causes, fitted with all other parameters at their nominal values."""
    objective = scoring.objective
    none = np.zeros(0)
    alone = replace(objective, nominal=NominalParameters((), none, none, none))
    members = exact_members(one, hypotheses.candidates, scoring.ids)
    there = {c.key for c in members}
    members = (*members, *(c for c in one.fit.candidates if c.key not in there))
    names = {n for c in members for n in c.names}
    fit = refit_until_converged(alone, members, {n: v for n, v in one.fit.values.items() if n in names})
    return {n: v for n, v in (fit.values if fit is not None else one.fit.values).items() if n in names}


def _hidden(
    chosen: ScoredHypothesis, scoring: Scoring, left: Callable[[Setting], float]
) -> tuple[dict[CauseKey, set[str]], float]:
    """The parameters that the refit hides, by the effect that stands for them, and the gap left with them."""
    values = chosen.fit.values
    of_causes, others = _beside(chosen, scoring.ids)

    def rest_with(names: set[str]) -> float:
        return left({n: v for n, v in values.items() if n in names})

    added: dict[CauseKey, set[str]] = {}
    names, rest = set(of_causes), rest_with(of_causes)
    room = min(MAX_ABSORBED, MAX_CAUSES - len(chosen.causes))
    while others and len(added) < room and rest >= scoring.threshold:
        rests = {key: rest_with(names | own) for key, own in others.items()}
        best = min(rests, key=lambda key: rests[key])
        rest = rests[best]
        added[best] = others.pop(best)
        names |= added[best]
    return added, rest
