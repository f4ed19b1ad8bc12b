"""What happens to a selected cause that the log does not need, and how the level of model errors enters intervals."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses
from ehsa_ctrl.diagnosis.model_selection import Reference, select_model
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.pruning import prune
from ehsa_ctrl.diagnosis.refit import refit
from ehsa_ctrl.diagnosis.scoring import Scoring
from ehsa_ctrl.diagnosis.sizes import fit_sizes

THRESHOLD = 0.03


@pytest.fixture(scope="module")
def segments(carriage_segments):
    return carriage_segments()


def candidate(hypotheses, id):
    return next(one for one in hypotheses.candidates if one.id == id)


def start(segments):
    objective, sensitivities = objective_of(segments.training, THRESHOLD)
    candidates = tuple(candidate_effects(segments.training.model))
    return Hypotheses.initial(objective, candidates, sensitivities, Pool())


def test_a_cause_that_the_log_does_not_need_is_dropped(segments):
    """A search may leave a set with a wrong size of a superfluous effect; the mass alone explains the log."""
    hypotheses = start(segments)
    members = candidate(hypotheses, "payload_mass"), candidate(hypotheses, "rod_viscous_friction")
    plant = segments.training.model.plant
    wrong = {"M": plant["M"] / 1.4, "Fv": 1.2 * plant["Fv"]}
    unfinished = refit(hypotheses.objective, members, wrong, {}, steps=0)
    hypotheses = hypotheses.with_fits([refit(hypotheses.objective, (), {}, {}, steps=0), unfinished])
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, THRESHOLD, lumped=False)
    scores = [scoring.score(fit) for fit in hypotheses.fits.values()]
    reference = Reference.of(scoring)
    before = select_model(scores, reference)

    after, _, all_scores = prune(before, scores, hypotheses, scoring, reference)

    assert {id for id, _ in before.chosen.causes} == {"payload_mass", "rod_viscous_friction"}
    assert [id for id, _ in after.chosen.causes] == ["payload_mass"]
    assert after.chosen.fit.values["M"] == pytest.approx(wrong["M"], rel=0.01)
    assert len(all_scores) > len(scores)


def test_a_smaller_set_that_was_fitted_badly_before_is_fitted_again(segments):
    """The search may have left the mass alone at a size far off, which would keep the superfluous friction."""
    hypotheses = start(segments)
    mass, friction = candidate(hypotheses, "payload_mass"), candidate(hypotheses, "rod_viscous_friction")
    plant = segments.training.model.plant
    true = plant["M"] / 1.4
    sets = [((), {}), ((mass,), {"M": 1.1 * plant["M"]}), ((mass, friction), {"M": true, "Fv": 1.2 * plant["Fv"]})]
    hypotheses = hypotheses.with_fits([refit(hypotheses.objective, c, v, {}, steps=0) for c, v in sets])
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, THRESHOLD, lumped=False)
    scores = [scoring.score(fit) for fit in hypotheses.fits.values()]
    reference = Reference.of(scoring)
    before = select_model(scores, reference)

    after, _, _ = prune(before, scores, hypotheses, scoring, reference)

    assert len(before.chosen.causes) == 2 and [id for id, _ in after.chosen.causes] == ["payload_mass"]
    assert after.chosen.fit.values["M"] == pytest.approx(true, rel=0.01)


def test_errors_of_the_model_widen_an_interval_once(segments):
    """The level divides the information; the roughness of the cost is small here, at any level."""
    hypotheses = start(segments)
    one = refit(hypotheses.objective, (candidate(hypotheses, "payload_mass"),), {}, {}, renew_after=1)
    level = 25.0

    _, sd = fit_sizes(hypotheses.objective, one)
    _, wide = fit_sizes(replace(hypotheses.objective, level=level), one)

    assert 0.5 * np.sqrt(level) < wide["M"] / sd["M"] < 2.0 * np.sqrt(level)
