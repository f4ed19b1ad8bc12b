"""The cushion before an end stop."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.physics.effects.end_stop import net_force

STOP = {"x_stop": np.inf, "K_stop": 1e8, "B_stop": 1e5}


def test_the_cushion_resists_motion_towards_the_end_alone():
    """C d v^2 at either end, nothing on the way back or before the cushion."""
    force = {
        (x, v): net_force(0.0, x, v, **STOP, x_cushion=0.03, C_cushion=1e7)
        for x in (-0.04, -0.02, 0.02, 0.04)
        for v in (-0.1, 0.1)
    }

    assert force[0.04, 0.1] == pytest.approx(-1e7 * 0.01 * 0.01, rel=1e-12)
    assert force[-0.04, -0.1] == pytest.approx(1e7 * 0.01 * 0.01, rel=1e-12)
    assert all(value == 0.0 for at, value in force.items() if at not in [(0.04, 0.1), (-0.04, -0.1)])


def test_a_cushion_out_of_reach_changes_no_bit(plant):
    """As that of a plant without one, which begins at infinity."""
    current = 2.0 * np.sin(np.linspace(0.0, 12.0, 501))
    stop = plant.with_effects("end_stop", x_stop=0.1)

    far, none = (ehsa_ctrl.simulate(stop.set(x_cushion=at), current) for at in (0.09, np.inf))

    np.testing.assert_array_equal(far.states, none.states)
