"""The search from the selected causes, on a carriage whose mass is wrong and that follows the force late."""

import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis import second_search
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses
from ehsa_ctrl.diagnosis.model_selection import Reference, select_model, selection_of
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.refit import refit, refit_until_converged
from ehsa_ctrl.diagnosis.scoring import Scoring
from ehsa_ctrl.diagnosis.second_search import search_from_selection

THRESHOLD = 0.03
#: By how much the motion is late [s].
LATE = 0.02
BOTH = "payload_mass", "drive_delay"


class Start:
    """Where a search from selected causes begins: fits and scores of sets of causes."""

    def __init__(self, segments, *sets):
        self.segments = segments
        self.objective, sensitivities = objective_of(segments.training, THRESHOLD)
        candidates = tuple(candidate_effects(segments.training.model))
        hypotheses = Hypotheses.initial(self.objective, candidates, sensitivities, Pool())

        def fit(ids):
            members = tuple(next(one for one in candidates if one.id == id) for id in ids)
            return refit_until_converged(self.objective, members, {})

        fits = [refit(self.objective, (), {}, {}, steps=0), *(fit(ids) for ids in sets)]
        # The weights are those of the best model, as at the end of a first search.
        best = hypotheses.with_fits([fit(BOTH)])
        self.scoring = Scoring.of(best, segments.training, segments.held_out, THRESHOLD, lumped=False)
        self.hypotheses = hypotheses.with_fits(fits)
        self.scores = [self.scoring.score(fit) for fit in fits]
        self.reference = Reference.of(self.scoring)

    def search(self, selection):
        """Selection afterwards, and the numbers of new scores and of simulations."""
        runs = self.objective.count.total
        after, _, found = search_from_selection(
            selection, self.scores, self.hypotheses, self.scoring, self.reference, self.segments.training
        )
        return after, len(found) - len(self.scores), self.objective.count.total - runs


@pytest.fixture(scope="module")
def selected(carriage_segments):
    """What the search does from a set of causes, fitted: the selections before and after, and the simulations."""
    segments = carriage_segments(LATE)

    def search(*ids):
        start = Start(segments, ids)
        before = select_model(start.scores, start.reference)
        return before, *start.search(before)

    return search


def test_a_set_that_was_known_before_is_not_selected(carriage_segments, monkeypatch):
    """Pruning refuses a smaller set that leaves a larger gap: selecting among all scores again would undo that."""
    start = Start(carriage_segments(LATE), ("payload_mass",), BOTH)
    ranked = select_model(start.scores, start.reference).ranked
    known, chosen = (next(one for one in ranked if len(one.causes) == size) for size in (2, 1))
    monkeypatch.setattr(second_search, "neighbours", lambda *_: [])

    after, more, _ = start.search(selection_of(chosen, ranked, start.reference))

    assert select_model(start.scores, start.reference).chosen is known
    assert after.chosen is chosen and after.ranked == ranked and more == 0


def test_a_missing_cause_is_found_from_the_selected_one(selected):
    before, after, _, _ = selected("payload_mass")
    assert [id for id, _ in before.chosen.causes] == ["payload_mass"]
    assert {id for id, _ in after.chosen.causes} == {*BOTH}
    assert after.chosen.fit.values["M"] == pytest.approx(ehsa_ctrl.load_plant("emps")["M"], rel=0.01)
    (delay,) = (c.names[0] for c in after.chosen.fit.candidates if c.id == "drive_delay")
    assert after.chosen.fit.values[delay] == pytest.approx(LATE, rel=0.05)


def test_nothing_is_searched_where_only_noise_is_left(selected):
    before, after, more, runs = selected(*BOTH)
    assert {id for id, _ in before.chosen.causes} == {*BOTH}
    assert after is before and more == 0 and runs == 0
