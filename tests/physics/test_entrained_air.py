"""Air that dissolves late under pressure."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.physics.effects.entrained_air import free_air, softening

CURRENT = 2.0 * np.sin(np.linspace(0.0, 12.0, 501))
AIR = {"air_fraction": 0.02, "n_air": 1.2}


def test_henrys_law():
    """In proportion to the rise, all of it never, and none at an infinite pressure; more is free below P_0."""
    assert free_air(0.02, 5e5, 20e5) == pytest.approx(0.015, rel=1e-14)
    assert free_air(0.02, -5e5, 20e5) == pytest.approx(0.025, rel=1e-14)
    assert free_air(0.02, 30e5, 20e5) > 0.0
    assert free_air(0.02, 30e5, np.inf) == 0.02
    assert softening(20e5, 1.4e9, free_air(0.02, 30e5, 20e5), 1.2) > softening(20e5, 1.4e9, 0.02, 1.2)


def test_a_slow_dissolution_leaves_the_air_free(plant):
    """With a lag much longer than the run; without dissolution its lag changes no bit, and no state moves."""
    free = ehsa_ctrl.simulate(plant.with_effects("entrained_air", **AIR), CURRENT)
    slow = ehsa_ctrl.simulate(plant.with_effects("entrained_air", **AIR, P_diss=10e5, tau_diss=1e4), CURRENT)
    other = ehsa_ctrl.simulate(plant.with_effects("entrained_air", **AIR, tau_diss=0.1), CURRENT)

    assert np.std(slow["dP"] - free["dP"]) < 1e-3 * np.std(free["dP"])
    np.testing.assert_array_equal(other.states, free.states)
    assert not free["P_H1"].any() and not free["P_H2"].any()
