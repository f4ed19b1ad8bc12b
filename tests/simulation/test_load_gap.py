"""A load behind a gap: contact at its instant, a push without a pull, the attached spring in contact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ehsa_ctrl import InputError, load_plant, simulate, simulate_reference
from ehsa_ctrl.physics import load

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


def mirrored(states):
    """States of the same rod seen from the other end: speeds and position turned, chambers exchanged."""
    return -states[:, 0], states[:, 2], states[:, 1], -states[:, 3], -states[:, 4]


def test_the_retracting_rod_meets_the_mirrored_load(plant):
    """With the current turned, and a symmetric plant, the run is that of the extending rod in the mirror."""
    V = 0.5 * (plant["V_10"] + plant["V_20"])
    symmetric = plant.set(V_10=V, V_20=V, x_0=0.0, K_S=1e6, k_3=1e12)
    extending = simulate(symmetric.set(x_C=0.004), CURRENT, tolerance=1e-9)
    retracting = simulate(symmetric.set(x_R=-0.004), -CURRENT, tolerance=1e-9)
    size = np.max(np.abs(extending.states), axis=0)

    assert np.max(extending.cell_force) > 1e3
    for column, turned in enumerate(mirrored(retracting.states)):
        assert np.max(np.abs(turned - extending.states[:, column])) < 1e-6 * size[column]
    np.testing.assert_allclose(retracting.cell_force, -extending.cell_force, rtol=0, atol=1e-3)


def test_between_two_loads_the_engine_does_as_scipy(plant):
    """Contacts on both sides: the states of SciPy's integrator with its own event location; free in between."""
    between = plant.set(K_S=1e6, x_C=0.003, x_R=-0.002)
    reference = simulate_reference(between, CURRENT, rtol=1e-9)
    run = simulate(between, CURRENT, tolerance=1e-9)
    x = run["x"]

    assert np.max(np.abs(run.states - reference.states) / np.max(np.abs(reference.states), axis=0)) < 1e-7
    assert np.max(x) > 0.003 and np.min(x) < -0.002
    np.testing.assert_allclose(run.cell_force, 1e6 * (np.maximum(x - 0.003, 0) + np.minimum(x + 0.002, 0)), atol=1e-6)


@given(
    x=st.floats(-0.1, 0.1), x_C=st.one_of(st.just(-np.inf), st.floats(0.0, 0.1)),
    x_R=st.one_of(st.just(-np.inf), st.floats(-0.1, 0.0)), k_3=st.floats(0.0, 1e9),
)  # fmt: skip
def test_the_load_is_a_spring_that_returns_what_it_takes(x, x_C, x_R, k_3):
    """Its force is the derivative of an energy that is never negative, and it only pushes; by central differences."""

    def force_at(position):
        return load.force(load.deflection(position, x_C, x_R), K_S=1e6, F_pre=0.0, k_3=k_3, F_0=0.0, F_D=0.0)

    def energy(position):
        s = load.deflection(position, x_C, x_R)
        return 0.5e6 * s * s + 0.25 * k_3 * s**4

    h = 1e-7
    slope = (energy(x + h) - energy(x - h)) / (2.0 * h)

    assert energy(x) >= 0.0
    assert force_at(x) == pytest.approx(slope, rel=1e-3, abs=1.0)
    if x_C > -np.inf or x_R > -np.inf:
        assert (x > x_C > -np.inf) if force_at(x) > 0.0 else (force_at(x) == 0.0 or x < x_R)


def test_the_gap_is_a_setting_like_any_other():
    """As the command line gives it; nan and a wrong unit are refused with the key."""
    assert load_plant("ehsa", settings={"load.gap": "4 mm"})["x_C"] == 0.004
    assert load_plant("ehsa", settings={"load.gap_retracting": "-4 mm"})["x_R"] == -0.004
    assert load_plant("ehsa")["x_C"] == load_plant("ehsa")["x_R"] == -np.inf
    with pytest.raises(InputError, match=r"load.gap: .*kg"):
        load_plant("ehsa", settings={"load.gap": "4 kg"})
