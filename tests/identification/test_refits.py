"""Fits repeated with a parameter held elsewhere: ranges of assumed parameters, and the profile likelihood."""

import dataclasses

import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.result import to_json
from ehsa_ctrl.identification.identify import identify
from ehsa_ctrl.identification.refits import assumption_sensitivities, profile
from ehsa_ctrl.report.results import write_result_page


@pytest.fixture(scope="module")
def estimate():
    plant = ehsa_ctrl.load_plant("ehsa")
    parameter = plant.parameters["beta"]
    beta = dataclasses.replace(parameter, lower=0.9 * parameter.value, upper=1.2 * parameter.value)
    still = {"K_T": "given", "tau_FM": "given"}
    parameters = {
        name: dataclasses.replace(p, source=still.get(name, p.source)) for name, p in plant.parameters.items()
    } | {"beta": beta}
    plant = dataclasses.replace(plant, parameters=parameters)
    made = ehsa_ctrl.excitation("noise", amplitude=3, duration=6, sample_time=0.004, seed=1)
    log, _ = ehsa_ctrl.record(plant, *made, centre=True, seed=1)
    return identify(plant, log, fix=[name for name in plant.free if name not in ("V_10", "V_20", "J_M")], starts=1)


@pytest.fixture(scope="module")
def sensitivities(estimate):
    return assumption_sensitivities(estimate)


def test_only_what_is_assumed_and_has_a_range_is_tried(sensitivities):
    """Neither what was given nor what no file gives a range."""
    assert [each.parameter.name for each in sensitivities] == ["beta"]


def test_volumes_go_with_the_bulk_modulus(estimate, sensitivities):
    """A chamber's stiffness is beta / V: a log that shows the stiffness moves the volumes as beta moves."""
    (each,) = sensitivities
    for end, factor in zip(each.ends, (0.9, 1.2), strict=True):
        for name in ("V_10", "V_20"):
            assert end.values[name] / estimate[name].value == pytest.approx(factor, rel=0.03)
        assert end.values["J_M"] / estimate["J_M"].value == pytest.approx(1.0, abs=0.01)


def test_the_estimate_is_the_best(estimate, sensitivities):
    """With the nominal value the fit is at its minimum: at an end it is worse, or better by no more than noise."""
    (each,) = sensitivities

    assert each.cost == estimate.fit.reduced_cost
    assert all(end.cost > 0.999 * each.cost for end in each.ends)


def test_the_page_shows_by_how_much_each_moves(estimate, sensitivities, tmp_path):
    """A column an end, in percent of the estimate, and what follows in a sentence."""
    ranges = [each.to_dict() for each in sensitivities]
    content = {**estimate.to_dict(), "model": "nonlinear", "plant": "ehsa", "assumed_ranges": ranges}
    (tmp_path / "identification.json").write_text(to_json(content))
    text = write_result_page(tmp_path, "identification.json").read_text(encoding="utf-8")
    moved = 100.0 * (sensitivities[0].high.values["V_10"] / estimate["V_10"].value - 1.0)

    assert "Sensitivity to assumed parameters" in text
    assert f"{moved:+.2g} %" in text


def test_balances_have_no_simulation_to_fit_again(estimate):
    """Said in a sentence."""
    with pytest.raises(InputError, match="not by balances"):
        assumption_sensitivities(dataclasses.replace(estimate, fit=None))


@pytest.mark.slow
def test_the_profile_of_a_well_determined_parameter_is_a_parabola(from_truth):
    """One, two, three deviations raise the cost by one, four, nine, and the interval is that of the deviation."""
    line = profile(from_truth, "A_FR")

    assert line.rise == pytest.approx([9, 4, 1, 1, 4, 9], rel=0.1)
    assert line.interval == pytest.approx(from_truth["A_FR"].interval, abs=0.1 * from_truth["A_FR"].sd)


def test_what_has_no_profile(found):
    """A parameter that was not estimated has none."""
    with pytest.raises(InputError, match="K_T was not estimated"):
        profile(found, "K_T")
