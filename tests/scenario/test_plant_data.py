"""Data of a plant for a review."""

from math import isnan

import pytest

from ehsa_ctrl.plant.motion_current import motion_current
from ehsa_ctrl.scenario.plant_data import known_of


def test_a_nonlinear_plant_tells_its_friction_and_its_stroke(plant):
    """The current at breakaway is that of both contacts; the rod goes half its stroke to either side."""
    p, found = plant.values, known_of(plant)
    rod = p["D"] / p["A"] * (p["A_FR"] + p["C_FR"])

    assert found.static == pytest.approx((p["A_FM"] + p["C_FM"] + rod) / p["K_T"])
    assert found.coulomb == motion_current(plant)["coulomb"] < found.static
    assert found.reach == plant.limits["stroke"].value / 2
    assert isnan(found.slip) and isnan(found.solver_time)


def test_a_linear_plant_tells_its_noise_alone(linear):
    """The linear set does not stick, so it provides no friction."""
    found = known_of(linear)

    assert isnan(found.static) and isnan(found.coulomb) and isnan(found.reach)
    assert found.noise["position"] == linear.sensors["position"].sd > 0
