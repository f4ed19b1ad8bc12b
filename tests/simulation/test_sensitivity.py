"""Derivatives of runs: against differences at tight tolerance, through stops and breakaways."""

import numpy as np
import pytest

from ehsa_ctrl import InputError, sensitivities, simulate


@pytest.mark.parametrize(("hold", "gap"), [("zero_order", -np.inf), ("first_order", 2e-3)])
def test_derivatives_are_those_of_differences(plant, hold, gap):
    """Every parameter of the nonlinear set, over a second of stick-slip under the spring, attached or behind a gap."""
    loaded = plant.set(K_S=5e4, x_C=gap)
    current = 1.8 * np.sin(np.linspace(0, 12, 251))
    zero = {"F_pre", "k_3", "F_0", "m_L", "x_0", "x_C", "x_R"}
    # Behind a gap, only what its contact concerns: the other derivatives are those above.
    names = ["K_T", "A_FR", "K_S", "x_C"] if np.isfinite(gap) else [n for n in plant.parameters if n not in zero]
    found = sensitivities(loaded, names, current, hold=hold, tolerance=1e-10)
    reversals = np.count_nonzero(np.diff(simulate(loaded, current, hold=hold).modes[:, 1]))

    assert reversals > 5
    for k, name in enumerate(names):
        step = 1e-6 * loaded[name]
        ahead = simulate(loaded.set(**{name: loaded[name] + step}), current, hold=hold, tolerance=1e-11).states
        behind = simulate(loaded.set(**{name: loaded[name] - step}), current, hold=hold, tolerance=1e-11).states
        differences = (ahead - behind) / (2 * step)
        # A change of the parameter by itself moves a state by so much; what is far less counts as none at all.
        least = 1e-5 * np.array([100, 5e5, 5e5, 0.05, 0.02]) / loaded[name]
        peak = np.maximum(np.max(np.abs(differences), axis=0), least)

        assert np.max(np.abs(found.values[:, :, k] - differences) / peak) < 2e-3, name


def test_load_and_initial_state(plant):
    """Loads that are zero, and the state the run starts from."""
    current = np.full(126, 1.6)
    start = plant.rest + np.array([20.0, 1e5, -1e5, 0.01, 0.001])
    found = sensitivities(plant, ["F_0", "m_L"], current, initial_states=["omega", "v"], start=start, tolerance=1e-10)
    moved = start + np.array([1e-4, 0, 0, 0, 0])
    by_omega = (simulate(plant, current, start=moved, tolerance=1e-12).states - found.states) / 1e-4
    by_force = (simulate(plant.set(F_0=1e-2), current, start=start, tolerance=1e-12).states - found.states) / 1e-2

    assert found.names == ("F_0", "m_L", "initial omega", "initial v")
    assert np.allclose(found.values[:, 0, 2], by_omega[:, 0], atol=1e-3)
    assert np.allclose(found.values[:, 4, 0], by_force[:, 4], atol=1e-3 * np.max(np.abs(by_force[:, 4])))


def test_a_contact_that_sticks_has_no_derivative(plant):
    """Below breakaway nothing moves, whatever the parameters: all derivatives but that of P_0 are zero."""
    found = sensitivities(plant, ["J_M", "A_FM", "B_FR", "P_0"], np.full(50, 0.5))

    assert np.all(found.values[:, :, :3] == 0.0)
    assert np.all(found.values[:, 1:3, 3] == 1.0)


def test_an_unknown_name_offers_the_nearest(plant):
    """A wrong symbol is a sentence."""
    with pytest.raises(InputError, match="did you mean 'A_FR'"):
        sensitivities(plant, ["A_FX"], np.zeros(10))
