"""Torque that rises less with high current: smoothly, or beyond a knee."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.physics.effects.torque_saturation import torque

CURRENT = 3.0 * np.sin(np.linspace(0.0, 12.0, 501))


def test_closed_form():
    """K_T I up to the knee, K_T (I_knee + s (I - I_knee)) beyond it, odd in the current."""
    for sign in (1.0, -1.0):
        assert torque(1.2 * sign, sign, 1.2, 0.0, 2.0, 0.3) == 1.2 * sign
        assert torque(1.2 * sign * 5.0, sign * 5.0, 1.2, 0.0, 2.0, 0.3) == pytest.approx(1.2 * sign * 2.9, rel=1e-14)
    assert torque(0.0, 0.0, 1.2, 0.0, 0.0, 0.3) == 0.0
    assert torque(2.4, 2.0, 1.2, 0.5, np.inf, 0.3) == pytest.approx(1.2, rel=1e-14)


@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_a_knee_is_a_lower_current(plant, slope):
    """The run is that of a plant without the knee under the current that is left."""
    rig = plant.with_effects("torque_saturation", k_sat=0.0, I_knee=1.6, s_knee=slope)
    beyond = np.maximum(np.abs(CURRENT) - 1.6, 0.0)
    left = CURRENT - np.sign(CURRENT) * (1.0 - slope) * beyond

    np.testing.assert_allclose(
        ehsa_ctrl.simulate(rig, CURRENT).states, ehsa_ctrl.simulate(plant, left).states, rtol=1e-6, atol=1e-9
    )
