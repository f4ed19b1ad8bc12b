"""Draws of plants, and operating points."""

import json

import numpy as np
import pytest

from ehsa_ctrl import InputError, load_plant, three_state
from ehsa_ctrl.plant.conditions import Condition, conditions, operating_points
from ehsa_ctrl.plant.draws import Covariance, difference, draw, drawn_models, read_covariance


def with_sd(plant, **sds):
    """The plant with standard deviations of some parameters."""
    from dataclasses import replace

    changed = {name: replace(plant.parameters[name], sd=sd) for name, sd in sds.items()}
    return replace(plant, parameters={**plant.parameters, **changed})


def test_draws_have_the_sd_and_stay_within(linear):
    """Normal, cut at two standard deviations: the spread is 0.88 of one; the others keep their values."""
    plant = with_sd(linear, M=1.0)
    drawn = draw(plant, 2000, seed=1)
    masses = np.array([one["M"] for one in drawn])

    assert np.max(np.abs(masses - plant["M"])) <= 2.0
    assert np.mean(masses) == pytest.approx(plant["M"], abs=0.1)
    assert np.std(masses) == pytest.approx(0.8796, rel=0.05)
    assert {one["J_M"] for one in drawn} == {plant["J_M"]}


def test_the_same_seed_gives_the_same_plants(linear):
    """Another seed gives other plants."""
    values = [[one["M"] for one in draw(linear, 5, seed=seed, unknown=0.1)] for seed in (3, 3, 4)]

    assert values[0] == values[1] != values[2]


def test_a_covariance_is_drawn_together(linear):
    """Draws have the correlation of the covariance and stay within the ellipsoid of two standard deviations."""
    names = ("J_M", "B_FM")
    sd = np.array([1e-5, 1e-4])
    matrix = np.outer(sd, sd) * np.array([[1.0, -0.95], [-0.95, 1.0]])
    drawn = draw(linear, 1500, seed=2, covariance=Covariance(names, matrix))
    off = np.array([[one[name] - linear[name] for name in names] for one in drawn])
    distance = np.einsum("ni,ij,nj->n", off, np.linalg.inv(matrix), off)

    assert np.corrcoef(off.T)[0, 1] == pytest.approx(-0.95, abs=0.02)
    # 95.45 % of two normal numbers lie inside a radius whose square is -2 ln(1 - 0.9545).
    assert np.max(distance) == pytest.approx(-2 * np.log(1 - 0.9545), rel=0.02)


def test_every_draw_is_inside_its_bounds(plant):
    """Normal draws respect the bounds; with assumed=True assumed parameters are uniform between theirs."""
    plant = with_sd(plant, tau_FR=0.01)
    drawn = draw(plant, 300, seed=5, names=["tau_FR", "K_T"], assumed=True)
    tau, K_T = (np.array([one[name] for one in drawn]) for name in ("tau_FR", "K_T"))

    assert np.min(tau) >= 0.002 and np.max(tau) <= 0.02
    assert 0.87 <= np.min(K_T) < 0.9 and 1.57 < np.max(K_T) <= 1.6


def test_what_is_assumed_stays_unless_it_is_asked_for(linear):
    """K_T and beta have bounds but no sd."""
    for one in draw(linear, 20, unknown=0.05):
        assert (one["K_T"], one["beta"]) == (linear["K_T"], linear["beta"])
        assert one["J_M"] != linear["J_M"]


def test_a_covariance_is_read_from_an_identification(tmp_path, plant):
    """null is an infinite variance: the parameter is not drawn."""
    content = {"correlation": {"names": ["M", "K_L"], "covariance": [[0.04, 0.0], [0.0, None]]}}
    (tmp_path / "identification.json").write_text(json.dumps(content))
    covariance = read_covariance(tmp_path / "identification.json")
    drawn = draw(plant, 50, covariance=covariance)

    assert np.isinf(covariance.matrix[1, 1])
    assert {one["K_L"] for one in drawn} == {plant["K_L"]}
    assert 0.1 < np.std([one["M"] for one in drawn]) < 0.25


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "no parameter of ehsa"),
        ({"names": ["J"], "unknown": 0.1}, "no parameter 'J'; "),
        ({"covariance": Covariance(("x",), np.eye(1))}, "has none of them"),
        ({"unknown": -1.0}, "expected n >= 1"),
    ],
)
def test_draws_that_make_no_sense_are_refused(linear, arguments, words):
    """One sentence."""
    with pytest.raises(InputError, match=words):
        draw(linear, 3, **arguments)


@pytest.mark.parametrize("text", ["{}", "nothing", '{"correlation": {"names": [], "covariance": []}}'])
def test_a_file_without_covariance_is_refused(tmp_path, text):
    """The message names the path."""
    (tmp_path / "a.json").write_text(text)

    with pytest.raises(InputError, match=r"a\.json"):
        read_covariance(tmp_path / "a.json")


def test_conditions_are_combined_and_named(linear):
    """Two springs and two masses make four models."""
    models = operating_points(linear, conditions(stiffnesses=[0.0, 50e3], masses=[0.0, 100.0]))
    last = models["K_S (load.stiffness) = 50 kN/m, m_L (load.mass) = 100 kg"]

    assert next(iter(models)) == "K_S (load.stiffness) = 0 kN/m, m_L (load.mass) = 0 kg" and len(models) == 4
    np.testing.assert_allclose(last.A, three_state(linear.set(K_S=50e3, m_L=100.0)).A)


def test_the_operating_point_is_felt_by_the_nonlinear_plant_alone(plant, linear):
    """Position changes the volumes of the nonlinear set only."""
    at = conditions(positions=[0.0, 0.08])
    near, far = operating_points(plant, at).values()
    same, still = operating_points(linear, at).values()

    assert not np.allclose(near.A, far.A)
    np.testing.assert_array_equal(same.A, still.A)


def test_draws_take_the_conditions_in_turn(linear):
    """Each label contains the condition and the differences, the largest first."""
    drawn = draw(linear, 3, unknown=0.05)
    models = drawn_models(linear, drawn, conditions(stiffnesses=[0.0, 50e3]))
    labels = list(models)

    assert labels[:2] == ["K_S (load.stiffness) = 0 kN/m", "K_S (load.stiffness) = 50 kN/m"] and len(labels) == 5
    assert labels[3].startswith("draw 2 at K_S (load.stiffness) = 50 kN/m: ")
    np.testing.assert_allclose(models[labels[3]].A, three_state(drawn[1].set(K_S=50e3)).A)
    assert next(iter(drawn_models(linear, drawn))) == "nominal"


def test_a_difference_is_told_by_its_size(linear):
    """In percent, the largest first; a change from zero in the unit."""
    assert difference(linear.set(M=1.1 * linear["M"], J_M=0.8 * linear["J_M"]), linear) == "J_M -20 %, M +10 %"
    assert difference(linear.set(m_L=20.0), linear) == "m_L (load.mass) 20 kg"
    assert difference(linear, linear) == "nominal"


def test_a_condition_without_a_speed_is_refused():
    """One sentence."""
    with pytest.raises(InputError, match="positions or velocities is empty"):
        conditions(velocities=[])


def test_a_plant_that_sticks_has_no_linear_model(plant):
    """The same message as from linearise."""
    with pytest.raises(InputError, match="sticks at rest"):
        Condition(velocity=0.0).model(plant)


def test_the_paper_file_gives_no_deviation():
    """The shipped plant states no sd; if it did, the examples should use it."""
    assert all(p.sd is None for p in load_plant("ehsa").parameters.values())
