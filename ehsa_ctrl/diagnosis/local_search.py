"""Local search around the best set of causes: one cause more, one less, or one in exchange for another.

The first search adds effects one by one to the nominal plant. Where several parameters are off beside an effect, it may
begin with a wrong one. Here the moves start from the best sets that it found, with responses linearised there. The
cost is that over short windows where the log allows it, because it has fewer local minima than that of a long free run
(see `refit.refit_by_windows`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..physics.effects import CandidateEffect
from .hypothesis_search import (
    MIN_ADDED_GAIN,
    MIN_GAIN,
    MIN_GAIN_SHARE,
    Hypotheses,
    Key,
    Task,
    distinct_tasks,
    hypothesis_key,
)
from .objective import TEMPER
from .records import Segment
from .refit import HypothesisFit
from .screening import Gain, Screening

# The numbers below are engineering judgement: computing time against the risk of missing a cause.

#: Rounds of moves; effects that are tried beside a set, and in exchange for each of its causes; fits to refine.
ROUNDS, ADDED, EXCHANGED, REFINED = 5, 4, 2, 3
#: Hypotheses with more causes are not proposed: no log of one rig tells so many apart.
MAX_CAUSES = 6
#: Sets that are proposed: of the best size, of one more and of one less each.
PROPOSED = 2


def neighbours(hypotheses: Hypotheses, bases: Sequence[HypothesisFit], searched: Segment) -> list[Task]:
    """Sets of causes near the bases that explain the training data better, or as well with fewer causes.

    searched: training data or a stretch of them, best in short windows.
    """
    if not bases:
        return []
    objective = replace(hypotheses.objective, segment=searched, level=1.0)
    found = Hypotheses.initial(objective, hypotheses.candidates, {}, hypotheses.pool)

    found = found.with_converged_refits([Task(fit.candidates, fit.values) for fit in bases], "neighbouring sets")
    if not found.fits:
        return []
    found = found.with_level_of(found.best()[0])
    screening = found.screening(_best(found))
    moved: set[Key] = set()
    for _ in range(ROUNDS):
        base = _best(found)
        key = hypothesis_key(base.candidates)
        if key in moved:
            break
        moved.add(key)
        found = _round(found, screening, base)
    size = len(_best(found).candidates)
    best = [fit for near in (size, size - 1, size + 1) if near > 0 for fit in found.best(near)[:PROPOSED]]
    return distinct_tasks(Task(fit.candidates, fit.values) for fit in best)


def _round(found: Hypotheses, screening: Screening, base: HypothesisFit) -> Hypotheses:
    """All moves from a base."""
    left_out = base.candidates if len(base.candidates) > 1 else ()
    reduced = [
        Task(tuple(c for c in base.candidates if c is not out), base.without(out, found.objective), base)
        for out in left_out
    ]
    found = found.with_refits(reduced, "neighbouring sets", steps=3)
    tasks = _additions(screening.gains(base), base, ADDED) if len(base.candidates) < MAX_CAUSES else []
    for out, task in zip(left_out, reduced, strict=True):
        for fit in found.fits_of([task]):
            gains = screening.gains(fit)
            tasks += _additions(gains, fit, EXCHANGED, out)
            tasks += _other_forms(gains, fit, out)
    known = set(found.fits)
    tasks = [task for task in distinct_tasks(tasks) if hypothesis_key(task.candidates) not in known]
    found = found.with_refits(tasks, "neighbouring sets", steps=4)
    best = sorted(found.fits_of([*reduced, *tasks]), key=lambda fit: _price(found, fit))
    return found.refine(best[:REFINED])


def _additions(
    gains: Sequence[Gain], fit: HypothesisFit, count: int, left_out: CandidateEffect | None = None
) -> list[Task]:
    """A fit with each of the effects that promise most beside it, without the one that was just left out."""
    tasks: list[Task] = []
    seen = set() if left_out is None else {left_out.key}
    for gain in gains:
        if gain.decrease < MIN_ADDED_GAIN or len(tasks) >= count:
            break
        if gain.candidate.key in seen:
            continue
        seen.add(gain.candidate.key)
        tasks.append(_added(fit, gain))
    return tasks


def _other_forms(gains: Sequence[Gain], fit: HypothesisFit, left_out: CandidateEffect) -> list[Task]:
    """A fit with each other form of the effect that was just left out: a mass on the rod for one behind the cell."""
    forms = (gain for gain in gains if gain.candidate.key == left_out.key)
    return distinct_tasks(_added(fit, gain) for gain in forms if gain.candidate.names != left_out.names)


def _added(fit: HypothesisFit, gain: Gain) -> Task:
    """A fit with one more effect, after the step that the screening predicts."""
    return Task((*fit.candidates, gain.candidate), gain.start(fit.values), fit)


def _price(found: Hypotheses, fit: HypothesisFit) -> float:
    """Cost of a fit with what each further cause must gain."""
    explained = TEMPER * found.objective.loss(found.residual) - found.best()[0].cost
    return fit.cost + (MIN_GAIN + MIN_GAIN_SHARE * max(explained, 0.0)) * len(fit.candidates)


def _best(found: Hypotheses) -> HypothesisFit:
    return min(found.fits.values(), key=lambda fit: _price(found, fit))
