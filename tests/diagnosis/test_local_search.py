"""Local search from a wrong set of causes, on a log of a rig whose parameters are known."""

import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses
from ehsa_ctrl.diagnosis.local_search import neighbours
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.refit import refit_until_converged
from ehsa_ctrl.diagnosis.validation_segment import windows_of


def problem(**changes):
    """Hypotheses of the nominal plant without fits, training data and windows, on a log of a rig with these changes."""
    plant = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    rig = plant.set(**changes)
    time, current = ehsa_ctrl.excitation("noise", amplitude=4, duration=12, seed=3)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=3, centre=True)
    prepared = prepare_logs(plant, [log], None, 0.03, check=True)
    training = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True).training
    objective, sensitivities = objective_of(training, 0.03)
    hypotheses = Hypotheses.initial(objective, tuple(candidate_effects(training.model)), sensitivities, Pool())
    return rig, hypotheses, windows_of([plant], training)


@pytest.mark.slow
def test_the_moves_lead_from_a_wrong_set_to_the_true_one():
    """Neither cause of the base is right, so each must be exchanged, one after the other."""
    nominal = ehsa_ctrl.load_plant("ehsa")
    rig, hypotheses, windows = problem(K_L=6.0 * nominal["K_L"], A_FM=1.15 * nominal["A_FM"])
    wrong = "external_leakage", "rotor_inertia"
    members = tuple(next(c for c in hypotheses.candidates if c.id == id) for id in wrong)
    base = refit_until_converged(hypotheses.objective, members, {})

    proposed = neighbours(hypotheses, [base], windows)

    best = proposed[0]
    assert {c.id for c in best.candidates} == {"internal_leakage", "motor_friction"}
    assert best.start["K_L"] == pytest.approx(rig["K_L"], rel=0.1)
    assert best.start["A_FM"] == pytest.approx(rig["A_FM"], rel=0.02)


@pytest.mark.slow
def test_another_form_of_an_effect_is_a_move():
    """The load cell does not feel a mass on the rod, but does feel one behind it."""
    rig, hypotheses, windows = problem(M=250.0)
    forms = {c.names: c for c in hypotheses.candidates if c.id == "payload_mass"}
    base = refit_until_converged(hypotheses.objective, (forms["m_L",],), {})

    proposed = neighbours(hypotheses, [base], windows)

    assert [c.names for c in proposed[0].candidates] == [("M",)]
    assert proposed[0].start["M"] == pytest.approx(rig["M"], rel=0.05)
