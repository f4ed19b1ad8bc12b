"""The lag of the drive: first order and second."""

import numpy as np
import pytest

import ehsa_ctrl

STEP = np.concatenate([np.zeros(25), np.full(476, 2.0)])


@pytest.fixture
def lagging(plant):
    """Plant with a lag of 20 ms -> current (N,) after a step of 2 A at 0.1 s."""

    def run(**shape):
        rig = plant.with_effects("drive_lag", tau_I=0.02, **shape)
        return ehsa_ctrl.simulate(rig, STEP, tolerance=1e-9)

    return run


def test_a_lag_of_first_order_is_exponential(lagging):
    run = lagging()
    since = np.maximum(run.time - 0.1, 0.0)

    np.testing.assert_allclose(run["I_A"], 2.0 * (1.0 - np.exp(-since / 0.02)), atol=2e-6)
    assert not run["V_A"].any()


@pytest.mark.parametrize("b", [0.5, 1.0, 2.0])
def test_a_lag_of_second_order_is_a_damped_oscillation(lagging, b):
    """The step response with natural frequency 1 / (tau sqrt(b)) and damping 1 / (2 sqrt(b))."""
    run = lagging(b_I=b)
    since = np.maximum(run.time - 0.1, 0.0)
    natural, damping = 1.0 / (0.02 * np.sqrt(b)), 0.5 / np.sqrt(b)
    damped = natural * np.sqrt(1.0 - damping**2)
    phase = np.cos(damped * since) + damping * natural / damped * np.sin(damped * since)

    np.testing.assert_allclose(run["I_A"], 2.0 * (1.0 - np.exp(-damping * natural * since) * phase), atol=2e-6)
