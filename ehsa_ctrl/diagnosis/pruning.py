"""Backward elimination of the selected causes: each is left out in turn, and the others are refitted.

The search grows sets, so that a set may hold a cause that a later one made superfluous, or two causes that the log
can't separate. Leaving one out shows both: if the rest explains the log as well, and leaves no larger gap on training
or held-out data, the selection takes the smaller set. Two causes that can each be left out, but not both, become
alternatives. Source: F. Harrell, "Regression Modeling Strategies", 2015, 4.3.
"""

from __future__ import annotations

from collections.abc import Sequence

from .hypothesis_search import Hypotheses, Key, Task, hypothesis_key
from .model_selection import Reference, Selection, select_model
from .scoring import ScoredHypothesis, Scoring, exact_members, new_scores
from .sizes import MAX_LARGER

#: Most causes that are left out one after the other. Engineering judgement: sets have at most six.
ROUNDS = 3


def prune(
    selection: Selection,
    scores: Sequence[ScoredHypothesis],
    hypotheses: Hypotheses,
    scoring: Scoring,
    reference: Reference,
) -> tuple[Selection, Hypotheses, list[ScoredHypothesis]]:
    """The selection among all scored hypotheses and those with one cause less than the selected; with these added."""
    scores, tried = list(scores), set[Key]()
    for _ in range(ROUNDS):
        chosen = selection.chosen
        members = exact_members(chosen, hypotheses.candidates, scoring.ids)
        if len(members) < 2:
            break
        tasks = []
        for left_out in members:
            rest = tuple(c for c in members if c is not left_out)
            tasks.append(Task(rest, chosen.fit.without(left_out, hypotheses.objective), chosen.fit))
        # A set that the search has fitted is fitted again from here: it may have ended in another minimum.
        tasks = [task for task in tasks if hypothesis_key(task.candidates) not in tried]
        tried |= {hypothesis_key(task.candidates) for task in tasks}
        if not tasks:
            break
        hypotheses = hypotheses.with_refits(tasks, "sets with one cause less", steps=6, renew_after=2)
        scores += new_scores(hypotheses, scoring, hypotheses.fits_of(tasks), scores)
        again = select_model(scores, reference)
        smaller = len(again.chosen.causes) < len(chosen.causes)
        if smaller and _costs(chosen, again.chosen) > MAX_LARGER * reference.threshold:
            break
        selection = again
        if not smaller:
            break
    return selection, hypotheses, scores


def _costs(before: ScoredHypothesis, after: ScoredHypothesis) -> float:
    """By how much the gap is larger afterwards, on training or on held-out data."""
    pairs = (before.training_gap, after.training_gap), (before.held_out_gap, after.held_out_gap)
    return max(b["total"] - a["total"] for a, b in pairs)
