"""Hypotheses for a rig of which several nominal parameters are off at once, beside an effect or without one.

The search gives nominal parameters narrow priors, so that none of them hides a cause, and adds causes one by one. Where
three parameters are off by 10 % beside an effect, no single step of it explains much. Here all nominal parameters get
the prior of a typical rig at once, alone and with each promising effect; backward elimination (F. Harrell, "Regression
Modeling Strategies", 2015, 4.3) then returns to their nominal values those that the log does not need. What is left is
an ordinary hypothesis: the effect, and the effects that stand for the wrong parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..physics.effects import CandidateEffect
from .candidate_effects import with_parameters
from .hypothesis_search import MIN_ADDED_GAIN, N_REFINE, Hypotheses, Task, distinct_tasks
from .local_search import MAX_CAUSES
from .objective import TEMPER, Objective
from .records import Segment
from .refit import HypothesisFit
from .screening import Screening

#: Effects and pairs that are fitted beside all nominal parameters, sets that are reduced.
SINGLES, PAIRS, REDUCED = 10, 6, 3
#: A parameter returns to its nominal value if that costs less than this, or less than this share of what the
#: hypothesis explains.
NEEDED, NEEDED_SHARE = 4.0, 0.004
#: A parameter that changes no signal by this share of the threshold is no cause.
SMALL = 0.7
#: Cost of the priors from which on nominal parameters are wrong by more than they usually are: two standard deviations.
MOVED = 4.0


def may_be_several(hypotheses: Hypotheses) -> bool:
    """Whether the best hypothesis leaves more than noise, or moves nominal parameters against their priors."""
    return hypotheses.objective.level > 1.0 or hypotheses.best()[0].prior_cost > MOVED


def with_several_parameters(
    hypotheses: Hypotheses, screening: Screening, ids: Mapping[str, str], threshold: float
) -> Hypotheses:
    """Hypotheses with sets of nominal parameters added. ids: parameter -> id of the effect that stands for it."""
    objective = hypotheses.objective
    nominal = objective.nominal
    wide = replace(objective, nominal=replace(nominal, sd=nominal.typical))
    start = replace(hypotheses, objective=wide, fits={})
    start = start.with_refits([Task((), {})], "all nominal parameters", steps=6, renew_after=3)
    if () not in start.fits:
        return hypotheses
    start = start.with_level_of(start.fits[()])
    # An effect may set a nominal parameter free beside its own number; those that stand for one are free already.
    beside = [c for c in hypotheses.candidates if c.id not in {ids.get(n) for n in c.names if n in nominal.names}]
    found = _grow(start, screening, [start.fits[()]], beside, SINGLES)
    found = found.refine(found.best(1)[:REDUCED], steps=5)
    found = found.with_level_of(found.best()[0])
    found = _grow(found, screening, found.best(1)[:REDUCED], beside, PAIRS)
    found = found.refine(found.best(2)[:REDUCED], steps=5)
    found = found.with_level_of(found.best()[0])
    fits = [found.fits[()], *found.best(1)[:REDUCED], *found.best(2)[:REDUCED]]
    tasks = distinct_tasks(
        Task(with_parameters(fit.candidates, kept, hypotheses.candidates, ids)[:MAX_CAUSES], values, fit).from_nominal()
        for fit in fits
        for kept, values in _eliminated(found, fit, threshold)
    )
    hypotheses = hypotheses.with_refits(tasks, "several nominal parameters", steps=5)
    return hypotheses.refine(sorted(hypotheses.fits_of(tasks), key=lambda fit: fit.cost)[:N_REFINE])


def _grow(
    found: Hypotheses,
    screening: Screening,
    bases: Sequence[HypothesisFit],
    beside: Sequence[CandidateEffect],
    count: int,
) -> Hypotheses:
    """Each base with the effects added that promise most beside all nominal parameters."""
    keys = {(c.key, c.names) for c in beside}
    options = []
    for base in bases:
        seen = set()
        for gain in screening.gains(base):
            candidate = gain.candidate
            form = candidate.key, candidate.names
            if gain.decrease < MIN_ADDED_GAIN or form not in keys or form in seen:
                continue
            seen.add(form)
            members = (*base.candidates, candidate)
            options.append((base.cost - gain.decrease, members, gain.start(base.values)))
    options.sort(key=lambda row: row[0])
    return found.with_refits([Task(members, start) for _, members, start in options[:count]], "effects beside", steps=4)


def _eliminated(found: Hypotheses, fit: HypothesisFit, threshold: float) -> list[tuple[list[str], dict[str, float]]]:
    """Names of the nominal parameters that stay, the most needed first, and all values; and these without the last one
    and two. The values are those at which a linear model expects the optimum.

    A parameter that alone changes no signal by most of the threshold is no cause, and goes first.
    """
    objective = found.objective
    names = [f.name for f in fit.free]
    z = np.array([(fit.values[f.name] - f.nominal) / f.scale for f in fit.free])
    change = np.zeros(len(names))
    information = fit.information(objective)
    information[np.arange(fit.n_effect), np.arange(fit.n_effect)] += 1e-6
    covariance = np.linalg.inv(information)
    explained = TEMPER / objective.level * (objective.loss(found.residual) - objective.loss(fit.residual))
    limit = NEEDED + NEEDED_SHARE * max(explained, 0.0)
    size = _changes(objective, fit.jacobian)
    kept, order, changes = list(range(fit.n_effect, len(names))), [], {}
    while kept:
        changes[len(kept)] = change
        now = z + change
        price = np.array([now[i] ** 2 / covariance[i, i] for i in kept])
        small = np.array([abs(now[i]) * size[i] < SMALL * threshold for i in kept])
        k = int(np.argmin(np.where(small, price - 1e9, price)))
        if not small[k] and price[k] > limit:
            order.append(kept[k])
        else:
            order.clear()
        i = kept.pop(k)
        gain = covariance[:, i] / covariance[i, i]
        change = change - gain * now[i]
        covariance = covariance - np.outer(gain, covariance[i])
    changes[0] = change
    order.reverse()
    return [
        (
            [names[i] for i in order[:count]],
            {
                f.name: float(np.clip(fit.values[f.name] + d * f.scale, f.lower, f.upper))
                for f, d in zip(fit.free, changes[count], strict=True)
            },
        )
        for count in range(len(order), max(len(order) - 3, -1), -1)
    ]


def _changes(objective: Objective, jacobian: np.ndarray) -> np.ndarray:
    """(k,) largest change of a scored signal by one scale of each number, of the signal's standard deviation."""
    spread = Segment(objective.records, "").spread
    out = np.zeros(jacobian.shape[1])
    for row, (name, scale) in enumerate(objective.scale.scale.items()):
        if name in spread:
            part = np.array([objective.by_channel(column)[row] for column in jacobian.T])
            out = np.maximum(out, np.sqrt(np.mean(part**2, axis=1)) * scale / max(spread[name], 1e-300))
    return out
