"""Which wrong nominal parameters are named beside the selected causes, because a refit would hide them."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.absorbed_parameters import CLEARLY, with_absorbed_parameters, with_determined_parameters
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses
from ehsa_ctrl.diagnosis.model_selection import Reference, selection_of
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.refit import refit
from ehsa_ctrl.diagnosis.scoring import Scoring

THRESHOLD = 0.03
RIG = ehsa_ctrl.load_plant("emps")


def prepared(**nominal):
    """Hypotheses, scoring and reference of a carriage whose nominal plant has other values than the rig."""
    time = np.arange(0.0, 9.0, 0.004)
    force = 75.0 * np.sin(2.0 * np.pi * 0.9 * time) * np.where(np.sin(2.0 * np.pi * 0.17 * time) > 0.0, 1.0, 0.6)
    run = ehsa_ctrl.simulate(RIG, force, hold="first_order", sample_time=0.004)
    position = run["x"] + 1e-6 * np.random.default_rng(0).standard_normal(time.size)
    log = ehsa_ctrl.Log(time, {"drive_force": force, "position": position})
    logs = prepare_logs(RIG.set(**nominal), [log], None, THRESHOLD, check=True)
    segments = split_logs(logs, Segment((logs.logs[0].record,), log.name), has_gap=True)
    objective, sensitivities = objective_of(segments.training, THRESHOLD)
    candidates = tuple(candidate_effects(segments.training.model))
    hypotheses = Hypotheses.initial(objective, candidates, sensitivities, Pool())
    hypotheses = hypotheses.with_fits([refit(objective, (), {}, {}, steps=0)])
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, THRESHOLD, lumped=False)
    return hypotheses, scoring, Reference.of(scoring)


def hypothesis(hypotheses, scoring, causes, values):
    """Effects with these values, scored as they are; `causes` of them are causes."""
    members = tuple(next(c for c in hypotheses.candidates if c.id == id) for id in causes)
    fit = refit(hypotheses.objective, members, values, {}, steps=0)
    return replace(scoring.score(fit), causes=tuple((id, None) for id in causes))


def named(problem, *scored):
    """Ids of the causes where the first hypothesis is selected."""
    hypotheses, scoring, reference = problem
    selection = selection_of(scored[0], scored, reference)
    after, _ = with_absorbed_parameters(selection, hypotheses, scoring, reference)
    assert set(after.chosen.own_gaps) >= set(after.chosen.causes) and set(after.probability) >= set(after.chosen.causes)
    return [id for id, _ in after.chosen.causes]


@pytest.fixture(scope="module")
def one_wrong():
    return prepared(M=1.4 * RIG["M"])


@pytest.fixture(scope="module")
def two_wrong():
    return prepared(M=1.4 * RIG["M"], Fv=1.8 * RIG["Fv"])


def test_a_parameter_that_a_refit_would_hide_is_named(two_wrong):
    """With the viscous friction at its nominal value no mass closes the gap."""
    hypotheses, scoring, _ = two_wrong
    found = hypothesis(hypotheses, scoring, ["payload_mass"], {"M": RIG["M"], "Fv": RIG["Fv"]})

    assert named(two_wrong, found) == ["payload_mass", "rod_viscous_friction"]


def test_a_parameter_that_the_causes_do_not_need_is_not(one_wrong):
    """A fit that has moved it a little beside a wrong mass: the mass alone closes the gap as well."""
    hypotheses, scoring, _ = one_wrong
    found = hypothesis(hypotheses, scoring, ["payload_mass"], {"M": 0.85 * RIG["M"], "Fv": 1.5 * RIG["Fv"]})

    assert scoring.training.gap({"M": found.fit.values["M"]})["total"] > THRESHOLD
    assert named(one_wrong, found) == ["payload_mass"]


def test_another_set_that_hides_nothing_takes_the_place(two_wrong):
    """It has no more causes than the selected one with its hidden parameter, and fits better."""
    hypotheses, scoring, _ = two_wrong
    poor = hypothesis(hypotheses, scoring, ["rod_friction"], {"Fc": 1.02 * RIG["Fc"], "M": RIG["M"], "Fv": RIG["Fv"]})
    right = hypothesis(hypotheses, scoring, ["rod_viscous_friction", "payload_mass"], {"M": RIG["M"], "Fv": RIG["Fv"]})

    assert poor.deviance > right.deviance
    assert set(named(two_wrong, poor, right)) == {"rod_viscous_friction", "payload_mass"}


def determined(problem, distance, change=1.8):
    """Selection of a wrong mass beside a viscous friction that lies so many standard deviations off."""
    hypotheses, scoring, reference = problem
    found = hypothesis(hypotheses, scoring, ["payload_mass"], {"M": RIG["M"], "Fv": change * RIG["Fv"]})
    found = replace(found, fit=replace(found.fit, values={**found.fit.values, "Fv": RIG["Fv"]}))
    sd = {"Fv": (change - 1.0) * RIG["Fv"] / distance, "M": 0.01 * RIG["M"]}
    return with_determined_parameters(selection_of(found, [found], reference), sd, scoring)


def test_a_parameter_with_clearly_another_value_is_named(two_wrong):
    """Its difference makes a gap, and is many standard deviations."""
    after = determined(two_wrong, CLEARLY + 5.0)

    assert [id for id, _ in after.chosen.causes] == ["payload_mass", "rod_viscous_friction"]
    assert 0.5 < after.probability["rod_viscous_friction", None] <= after.probability["payload_mass", None]
    assert max(after.chosen.own_gaps["rod_viscous_friction", None].values()) > THRESHOLD


def test_an_uncertain_parameter_is_not_named(two_wrong):
    """As large a difference, within what the log leaves open."""
    after = determined(two_wrong, CLEARLY - 0.5)

    assert [id for id, _ in after.chosen.causes] == ["payload_mass"]


def test_a_difference_that_makes_no_gap_is_not_named():
    """However well the log tells it."""
    after = determined(prepared(M=1.4 * RIG["M"], Fv=1.01 * RIG["Fv"]), 30.0, 1.01)

    assert [id for id, _ in after.chosen.causes] == ["payload_mass"]
