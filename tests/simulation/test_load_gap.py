"""A load behind a gap: contact at its instant, a push without a pull, the attached spring in contact."""

import numpy as np
import pytest

from ehsa_ctrl import InputError, load_plant, simulate, simulate_reference

CURRENT = np.repeat([2.0, -2.0, 2.5, -3.0], 50)


@pytest.fixture(scope="module")
def plant():
    """The nonlinear EHSA; its shipped load is attached."""
    return load_plant("ehsa")


@pytest.mark.parametrize("stiffness", [1e5, 1e7])
def test_the_engine_meets_the_load_where_scipy_does(plant, stiffness):
    """Contacts and releases: the same states as SciPy's integrator with its own event location."""
    behind = plant.set(K_S=stiffness, x_C=0.004)
    reference = simulate_reference(behind, CURRENT, rtol=1e-9)
    size = np.max(np.abs(reference.states), axis=0)

    for tolerance, share in ((1e-6, 5e-6), (1e-9, 5e-8)):
        error = np.abs(simulate(behind, CURRENT, tolerance=tolerance).states - reference.states)
        assert np.max(error / size) < share
    touches = reference.states[:, 4] > 0.004
    assert np.count_nonzero(np.diff(touches)) >= 2


def test_before_contact_there_is_no_load(plant):
    """To rounding, also just short of the load; beyond it the load pushes and never pulls."""
    free, behind = simulate(plant, CURRENT), simulate(plant.set(K_S=1e6, x_C=0.004), CURRENT)
    first = int(np.argmax(behind["x"] > 0.004))

    np.testing.assert_allclose(behind.states[:first], free.states[:first], rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(behind.cell_force, 1e6 * np.maximum(behind["x"] - 0.004, 0.0), rtol=1e-12)


def test_in_contact_it_is_the_attached_spring(plant):
    """With constant volumes a rod that starts at the load moves as one with a spring at x = 0, shifted by the gap."""
    linear = load_plant("ehsa", model="linear")
    push = np.full(100, 1.0)
    attached = simulate(linear.set(K_S=1e6), push, tolerance=1e-9)
    behind = simulate(linear.set(K_S=1e6, x_C=0.01, x_0=0.01), push, tolerance=1e-9)

    np.testing.assert_allclose(behind["x"] - 0.01, attached["x"], rtol=0, atol=1e-11)
    np.testing.assert_allclose(behind.cell_force, attached.cell_force, rtol=0, atol=1e-4)


def test_the_gap_is_a_setting_like_any_other():
    """As the command line gives it; nan and a wrong unit are refused with the key."""
    assert load_plant("ehsa", settings={"load.gap": "4 mm"})["x_C"] == 0.004
    assert load_plant("ehsa")["x_C"] == -np.inf
    with pytest.raises(InputError, match=r"load.gap: .*kg"):
        load_plant("ehsa", settings={"load.gap": "4 kg"})
