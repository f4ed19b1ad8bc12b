"""Sizes of causes and their intervals, on logs of rigs whose parameters are known."""

import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.refit import refit
from ehsa_ctrl.diagnosis.sizes import fit_sizes, uncertain

#: What is off on the rig, as factors; the bulk modulus is not among the parameters that the search refits.
OFF = {"J_M": 1.08, "A_FM": 0.93, "B_FM": 1.1, "V_10": 1.07, "beta": 0.94, "A_FR": 1.06, "K_L": 2.5}


def sizes(plant, log, id):
    """Fit of the search, final fit and standard deviations of a single effect."""
    prepared = prepare_logs(plant, [log], None, 0.03, check=True)
    training = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True).training
    objective, sensitivities = objective_of(training, 0.03)
    candidate = next(c for c in candidate_effects(training.model) if c.id == id)
    searched = refit(objective, (candidate,), {}, sensitivities, renew_after=1)
    return searched, *fit_sizes(uncertain(objective, searched), searched)


@pytest.mark.slow
def test_intervals_hold_the_truth_where_nominal_parameters_are_off():
    """Each parameter is off by more than the search's priors expect; the final intervals of all hold the truth."""
    plant = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    rig = plant.set(**{name: factor * plant[name] for name, factor in OFF.items()})
    time, current = ehsa_ctrl.excitation("noise", amplitude=4, duration=12, seed=1)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=1, centre=True)

    searched, final, sd = sizes(plant, log, "internal_leakage")

    assert final.cost < searched.cost
    for name in OFF:
        assert abs(final.values[name] - rig[name]) < 2.6 * sd[name], name
    assert sd["A_FM"] < 0.03 * rig["A_FM"]
    assert sd["K_L"] < 0.3 * rig["K_L"]


@pytest.mark.slow
def test_what_a_log_does_not_tell_keeps_the_uncertainty_of_the_rig():
    """A slow ramp says nothing of the inertia: its standard deviation is that of a typical nominal value."""
    plant = ehsa_ctrl.load_plant("ehsa")
    time, current = ehsa_ctrl.excitation("ramp", amplitude=3, duration=12)
    log, _ = ehsa_ctrl.record(plant, time, current, seed=1)

    _, _, sd = sizes(plant, log, "internal_leakage")

    assert sd["J_M"] > 0.07 * plant["J_M"]
    assert sd["A_FM"] < 0.05 * plant["A_FM"]
