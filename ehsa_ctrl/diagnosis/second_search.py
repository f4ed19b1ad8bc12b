"""A second local search, from the selected causes, where they leave more than noise.

The first one begins at the best sets that grew from the nominal plant, and its responses are linear there. Where what
was selected leaves more than noise, a cause or the right form of one is missing, and from the selected causes, refitted
and pruned, it is often one move away. Where only noise is left, no set can be much better.
"""

from __future__ import annotations

from collections.abc import Sequence

from .hypothesis_search import Hypotheses
from .local_search import neighbours
from .model_selection import MARGIN, Reference, Selection, select_model, selection_of
from .pruning import prune
from .records import Segment
from .scoring import PARAMETER_PENALTY, ScoredHypothesis, Scoring, new_scores

#: Most searches, each from what the one before selected. Engineering judgement.
SEARCHES = 2


def search_from_selection(
    selection: Selection,
    scores: Sequence[ScoredHypothesis],
    hypotheses: Hypotheses,
    scoring: Scoring,
    reference: Reference,
    searched: Segment,
) -> tuple[Selection, Hypotheses, list[ScoredHypothesis]]:
    """The selection among all scored hypotheses and those near the selected one; with these added.

    searched: data of the local search, see `local_search.neighbours`.
    """
    scores = list(scores)
    for _ in range(SEARCHES):
        chosen = selection.chosen
        if reference.unexplained(chosen) <= MARGIN + PARAMETER_PENALTY * chosen.fit.n_effect:
            break
        near = neighbours(hypotheses, [chosen.fit], searched)
        hypotheses = hypotheses.with_compared_refits(near, "neighbouring sets")
        found = new_scores(hypotheses, scoring, hypotheses.fits_of(near), scores)
        scores += found
        again = select_model(scores, reference)
        if not any(one is again.chosen for one in found):
            # Pruning may have refused the known set that is selected here: the choice stays, with more alternatives.
            selection = selection_of(chosen, again.ranked, reference)
            break
        selection = again
        if selection.chosen.label == chosen.label and selection.chosen.deviance > chosen.deviance - MARGIN:
            break
        selection, hypotheses, scores = prune(selection, scores, hypotheses, scoring, reference)
    return selection, hypotheses, scores
