"""The verdict by what matters: threshold, floor, and what a free curve would reach."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis import explanation
from ehsa_ctrl.diagnosis.explanation import claimable_part, explain, only_parameters
from ehsa_ctrl.diagnosis.free_curve import CurveLog, FreeCurve, free_curve
from ehsa_ctrl.diagnosis.model_selection import Reference, Selection
from ehsa_ctrl.diagnosis.scoring import ScoredHypothesis
from ehsa_ctrl.diagnosis.signals import estimate_noise


def selection(gap, misfit, verdict="effect", deviance=0.0):
    """A selection that leaves a gap of one signal on both segments, and a deviance, of 1e4 of the nominal model."""
    gaps = {"speed": gap, "total": gap}
    key = ("rod_friction", None)
    chosen = ScoredHypothesis(SimpleNamespace(), deviance, {key: gaps}, gaps, gaps, (key,))
    return Selection(verdict, chosen, {}, {key: 1.0}, (chosen,), misfit)


@pytest.fixture
def verdict_of(monkeypatch):
    """Function: verdict where a free curve leaves `curve` of what the causes leave. before: nominal gap."""

    def run(gap, misfit, curve, floor=0.0, verdict="effect", deviance=0.0, before=0.1):
        found = FreeCurve("force", (), gap, curve * gap)
        monkeypatch.setattr(explanation, "free_curve", lambda *_: found)
        floors = ({"speed": floor, "total": floor},) * 2
        reference = Reference(0.0, 1e4, before, 0.7, floors, (before, before))
        return explain(selection(gap, misfit, verdict, deviance), reference, 0.03, []).verdict

    return run


def test_no_misfit_keeps_the_verdict(verdict_of):
    assert verdict_of(0.05, misfit=0.9, curve=0.1, verdict="ambiguous") == "ambiguous"


def test_a_large_rest_counts_however_small_it_is_beside_the_nominal_gap(verdict_of):
    """Three thresholds and more."""
    assert verdict_of(0.0899, misfit=0.9, curve=0.9, before=1.0) == "effect"
    assert verdict_of(0.0901, misfit=0.9, curve=0.9, before=1.0) == "partly"


def test_causes_that_close_little_explain_no_gap_of_which_the_robust_loss_sees_little(verdict_of):
    """Spikes of a sensor: the causes fit the rest down to noise, and leave what the spikes make."""
    assert verdict_of(0.066, misfit=0.9, curve=0.9) == "effect"
    assert verdict_of(0.068, misfit=0.9, curve=0.9) == "outside_catalogue"
    assert verdict_of(0.029, misfit=0.9, curve=0.9, before=0.04) == "effect"


def test_a_rest_that_does_not_matter_is_explained(verdict_of):
    """Residuals that are significant and small, which no curve of the same variables makes smaller."""
    assert verdict_of(0.02, misfit=5.0, curve=0.9) == "effect"


def test_a_rest_that_a_free_curve_closes_is_not(verdict_of):
    assert verdict_of(0.02, misfit=5.0, curve=0.2) == "partly"


def test_a_rest_that_matters_is_partly_explained_or_not_at_all(verdict_of):
    """It takes a third of the gap to claim a part."""
    assert verdict_of(0.05, misfit=5.0, curve=0.9) == "partly"
    assert verdict_of(0.08, misfit=5.0, curve=0.9) == "outside_catalogue"


def test_the_floor_does_not_count(verdict_of):
    """What noise of the logged input makes is left by the truth too."""
    assert verdict_of(0.04, misfit=5.0, curve=0.9, floor=0.035) == "effect"


def test_causes_that_close_little_do_not_explain_a_gap_near_the_floor(verdict_of):
    """The rest beyond the floor is below the threshold, but most of the gap is left."""
    assert verdict_of(0.066, misfit=1.5, curve=0.9, floor=0.065) == "effect"
    assert verdict_of(0.069, misfit=1.5, curve=0.9, floor=0.065) == "outside_catalogue"


def test_below_the_floor_it_does_not_matter_what_is_closed(verdict_of):
    """There the noise of the logged input decides, for the truth too; the nominal gap is 10 %."""
    assert verdict_of(0.12, misfit=1.5, curve=0.9, floor=0.125) == "effect"


def test_below_the_floor_the_deviance_says_whether_causes_imitate_what_the_catalogue_lacks(verdict_of):
    """They leave little of such a gap by chance; above the floor they explain it however much deviance they leave."""
    assert verdict_of(0.05, misfit=1.5, curve=0.9, floor=0.101, deviance=900.0) == "effect"
    assert verdict_of(0.05, misfit=1.5, curve=0.9, floor=0.101, deviance=1100.0) == "outside_catalogue"
    assert verdict_of(0.05, misfit=1.5, curve=0.9, floor=0.099, deviance=1100.0) == "effect"


def hypothesis(deviance, gaps, left=0.04):
    """A hypothesis that leaves a gap of one signal on both segments. gaps: id of a cause -> gap that it makes alone."""
    keys = {(id, None): {"speed": gap} for id, gap in gaps.items()}
    rest = {"speed": left, "total": left}
    fit = SimpleNamespace(candidates=(), rms=3.0)
    return ScoredHypothesis(fit, deviance, keys, rest, rest, tuple(keys))


def claimed(*hypotheses, nominal_gap=0.1):
    """Ids that are claimed where the first hypothesis is selected, and the deviance of the nominal model is 1000."""
    chosen = hypotheses[0]
    selected = Selection("effect", chosen, {}, dict.fromkeys(chosen.causes, 1.0), hypotheses, 3.0)
    part = claimable_part(selected, Reference(0.0, 1000.0, nominal_gap, 0.7, ({}, {}), (nominal_gap, nominal_gap)))
    return None if part is None else {id for id, _ in part.chosen.causes}


MANY = {"load_dependent_friction": 0.1, "payload_mass": 0.08, "torque_constant": 0.06, "rotor_inertia": 0.04}


def test_of_many_causes_the_effect_is_claimed_that_no_set_can_do_without():
    """Without it, the best set closes 20 % instead of 60 %; wrong numbers are never claimed."""
    assert claimed(hypothesis(100.0, MANY), hypothesis(300.0, {"rotor_inertia": 0.1}, left=0.08)) == {
        "load_dependent_friction"
    }


def test_where_most_is_closed_a_smaller_part_is_enough_if_both_measures_have_it():
    """80 % closed; without the effect, a fifth of the deviance is lost, and 31 or 13 % of what is closed."""
    chosen = hypothesis(100.0, MANY, left=0.02)

    assert claimed(chosen, hypothesis(300.0, {"presliding": 0.1}, left=0.045)) == {"load_dependent_friction"}
    assert claimed(chosen, hypothesis(300.0, {"presliding": 0.1}, left=0.03)) is None
    assert claimed(chosen, hypothesis(200.0, {"presliding": 0.1}, left=0.045)) is None


def test_an_effect_that_others_replace_or_that_large_numbers_may_imitate_is_not_claimed():
    poor = hypothesis(300.0, {}, left=0.08)

    assert claimed(hypothesis(100.0, MANY), hypothesis(300.0, {"presliding": 0.1}, left=0.05)) is None
    assert claimed(hypothesis(100.0, MANY | {"motor_friction": 0.8}), poor) is None


def test_a_larger_set_that_is_clearly_worse_replaces_no_effect():
    """96 % closed, 86 % by a larger set without the effect, which lacks a quarter; one that leaves as little does."""
    chosen = hypothesis(100.0, {"entrained_air": 0.1, "rotor_inertia": 0.05}, left=0.004)

    assert claimed(chosen, hypothesis(325.0, MANY, left=0.014)) == {"entrained_air"}
    assert claimed(chosen, hypothesis(325.0, MANY, left=0.005)) is None
    assert claimed(chosen, hypothesis(270.0, MANY, left=0.014)) is None


def test_a_form_that_fails_on_held_out_data_replaces_nothing():
    follows = replace(hypothesis(200.0, {"position_dependent_friction": 0.1}, left=0.03), held_out_gap={"total": 0.09})

    assert claimed(hypothesis(100.0, MANY), follows) == {"load_dependent_friction"}


def test_a_set_that_does_badly_on_held_out_data_gives_way_to_one_that_does_not():
    """If that one can't be excluded; neither closes a third here with 8 % left of 10."""
    badly, other = hypothesis(100.0, MANY, left=0.08), hypothesis(120.0, {"load_dependent_friction": 0.1})

    assert claimed(badly, other) == {"load_dependent_friction"}
    assert claimed(badly, replace(other, deviance=500.0)) is None
    assert claimed(badly) is None


def test_a_part_is_claimed_of_the_smallest_set_that_closes_as_much():
    """A leak that makes a large gap beside air, which no set can do without; 97 % closed with the leak and without."""
    numbers = {"torque_constant": 0.1, "rotor_inertia": 0.1}
    both = hypothesis(100.0, {"entrained_air": 2.0, "external_leakage": 9.0} | numbers, left=0.003)
    alone = hypothesis(150.0, {"entrained_air": 9.0} | numbers, left=0.0031)
    nothing = hypothesis(990.0, numbers, left=0.099)

    assert claimed(both, alone, nothing) == {"entrained_air"}
    assert claimed(both, replace(alone, training_gap={"total": 0.006}), nothing) is None


def test_a_smaller_set_takes_no_claim_away():
    """Neither one that itself closes less than a third, nor one whose deviance is larger by a fifth of what is
    explained."""
    third = hypothesis(100.0, MANY, left=0.0664)
    small = hypothesis(110.0, {"load_dependent_friction": 0.1}, left=0.0669)
    nothing = hypothesis(900.0, {"rotor_inertia": 0.1}, left=0.095)

    assert claimed(third, small, nothing) == {"load_dependent_friction"}
    large = hypothesis(900.0, {"presliding": 0.1}, left=0.021)
    assert claimed(hypothesis(100.0, MANY, left=0.02), large) == {"load_dependent_friction"}


def test_where_the_nominal_model_runs_away_a_small_difference_is_still_small():
    """Of a gap of 400 %, which the margins count as 100 %: an effect that closes 4 % more is not certain."""
    many = hypothesis(300.0, {"load_dependent_friction": 3.0, "entrained_air": 2.5}, left=0.12)
    without = hypothesis(340.0, {"load_dependent_friction": 3.0}, left=0.3)
    nothing = hypothesis(990.0, {"torque_constant": 0.1}, left=3.9)

    assert claimed(many, without, nothing, nominal_gap=4.0) == {"load_dependent_friction"}


def test_one_number_is_an_effect_and_several_are_parameters():
    plant = ehsa_ctrl.load_plant("ehsa")

    assert not only_parameters([("rotor_inertia", None)], plant)
    assert only_parameters([("rotor_inertia", None), ("rod_friction", None)], plant)
    assert not only_parameters([("rotor_inertia", None), ("entrained_air", None)], plant)
    # A spring that the nominal plant lacks is no wrong number.
    assert not only_parameters([("rotor_inertia", None), ("load_spring", None)], plant)


@pytest.fixture(scope="module")
def tight_spot():
    """The nominal plant, and a log of one whose friction is larger around x = 0."""
    plant = ehsa_ctrl.load_plant("ehsa")
    time, current = ehsa_ctrl.excitation("multisine", amplitude=4.0, duration=18.0, seed=2)
    rig = plant.with_effects("position_dependent_friction", h_FR=1.0, x_h=0.0, w_h=0.005)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=2, centre=True)
    return plant, rig, log


def test_a_free_curve_closes_what_the_plant_lacks_on_data_that_it_has_not_seen(tight_spot):
    plant, rig, log = tight_spot
    noise, edge = estimate_noise(log), len(log) * 2 // 3
    parts = (slice(0, edge),), (slice(edge, len(log)),)
    lacking, complete = (free_curve([CurveLog(one, log, noise, *parts)]) for one in (plant, rig))

    assert lacking.better
    assert lacking.place == "force"
    assert not complete.better
    assert np.isfinite(complete.with_curve)


def test_a_curve_is_carried_to_a_second_log(tight_spot):
    """Fitted to the first, injected into the second: the same gap as on the held-out part of one log."""
    plant, _, log = tight_spot
    edge = len(log) * 2 // 3
    first, second = log.rows(0, edge), log.rows(edge, len(log))
    noise = estimate_noise(log)
    whole = (slice(0, len(log)),)
    found = free_curve([CurveLog(plant, first, noise, whole, ()), CurveLog(plant, second, noise, (), whole)])

    assert found.better
    assert found.place == "force"
