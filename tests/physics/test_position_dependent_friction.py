"""Tight spots: one, two, and waves along the stroke."""

import numpy as np
import pytest

from ehsa_ctrl.physics.effects.position_dependent_friction import friction, profile


def test_one_spot():
    """A_FR (1 + h) at its place in both directions, a bell curve around it."""
    spot = {"A_FR": 800.0, "h_FR": 0.5, "x_h": 0.01, "w_h": 0.005, "n_h": 0.0, "h_FR2": 0.0, "x_h2": 0.0}

    assert friction(800.0, 1.0, 0.01, **spot) == 1200.0
    assert friction(-800.0, -1.0, 0.01, **spot) == -1200.0
    assert friction(800.0, 1.0, 0.015, **spot) == pytest.approx(800.0 + 400.0 * np.exp(-1.0), rel=1e-14)


def test_two_spots_add_up():
    """The second one has its own height and place; at one place both are one spot."""
    both = {"A_FR": 800.0, "h_FR": 0.5, "x_h": 0.01, "w_h": 0.002, "n_h": 0.0, "h_FR2": 0.25}

    assert friction(0.0, 1.0, 0.01, **both, x_h2=0.01) == pytest.approx(600.0, rel=1e-14)
    assert friction(0.0, 1.0, -0.03, **both, x_h2=-0.03) == pytest.approx(200.0, rel=1e-14)


def test_waves_have_no_level():
    """A period of 1 / n_h, a crest at x_h, a mean of zero."""
    x = np.linspace(0.0, 0.02, 1001)[:-1]
    waves = np.array([profile(at, 0.003, 1.0, 150.0) for at in x])

    assert profile(0.003 + 1.0 / 150.0, 0.003, 1.0, 150.0) == pytest.approx(1.0, rel=1e-12)
    assert profile(0.003 + 0.5 / 150.0, 0.003, 1.0, 150.0) == pytest.approx(-1.0, rel=1e-12)
    assert np.mean(waves) == pytest.approx(0.0, abs=1e-12)
