"""The cushion before an end stop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ehsa_ctrl
from ehsa_ctrl.physics.effects.end_stop import net_force

STOP = {"x_stop": np.inf, "K_stop": 1e8, "B_stop": 1e5}


def force(x, v, **cushion):
    """Of a cushion from 30 mm on, on a rod without another force."""
    none = {"B_cushion": 0.0, "K_cushion": 0.0, "C_cushion": 0.0}
    return net_force(0.0, x, v, **STOP, x_cushion=0.03, **{**none, **cushion})


@pytest.mark.parametrize(("number", "value", "power"), [("B_cushion", 1e6, 1), ("C_cushion", 1e7, 2)])
def test_the_throttle_of_a_cushion_resists_motion_towards_the_end_alone(number, value, power):
    """Its number times depth times a power of the speed at either end, nothing on the way back or before it."""
    found = {(x, v): force(x, v, **{number: value}) for x in (-0.04, -0.02, 0.02, 0.04) for v in (-0.1, 0.1)}

    assert found[0.04, 0.1] == pytest.approx(-value * 0.01 * 0.1**power, rel=1e-12)
    assert found[-0.04, -0.1] == pytest.approx(value * 0.01 * 0.1**power, rel=1e-12)
    assert all(value == 0.0 for at, value in found.items() if at not in [(0.04, 0.1), (-0.04, -0.1)])


@given(
    depth=st.floats(0.0, 0.02), v=st.floats(-0.5, 0.5), end=st.sampled_from([-1.0, 1.0]),
    B=st.floats(0.0, 1e8), K=st.floats(0.0, 1e6), C=st.floats(0.0, 1e9),
)  # fmt: skip
def test_a_cushion_gives_back_no_more_than_its_elastic_energy(depth, v, end, B, K, C):
    """The power into the rod is at most that of a spring of stiffness K, for any motion at either end."""
    x = end * (0.03 + depth)

    power = force(x, v, B_cushion=B, K_cushion=K, C_cushion=C) * v

    assert power <= -K * (abs(x) - 0.03) * end * v + 1e-9


def test_a_cushion_out_of_reach_changes_no_bit(plant):
    """As that of a plant without one, which begins at infinity."""
    current = 2.0 * np.sin(np.linspace(0.0, 12.0, 501))
    stop = plant.with_effects("end_stop", x_stop=0.1)

    far, none = (ehsa_ctrl.simulate(stop.set(x_cushion=at), current) for at in (0.09, np.inf))

    np.testing.assert_array_equal(far.states, none.states)
