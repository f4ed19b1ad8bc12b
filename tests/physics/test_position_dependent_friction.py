"""Tight spots: one, two, and waves along the stroke."""

import numpy as np
import pytest

from ehsa_ctrl.physics.effects.position_dependent_friction import COEFFICIENTS, friction, profile, series

#: Without a free profile.
FLAT = {"x_a": -0.1, "x_b": 0.1, **dict.fromkeys(COEFFICIENTS, 0.0)}


def test_one_spot():
    """A_FR (1 + h) at its place in both directions, a bell curve around it."""
    spot = {"A_FR": 800.0, "h_FR": 0.5, "x_h": 0.01, "w_h": 0.005, "n_h": 0.0, "h_FR2": 0.0, "x_h2": 0.0, **FLAT}

    assert friction(800.0, 1.0, 0.01, **spot) == 1200.0
    assert friction(-800.0, -1.0, 0.01, **spot) == -1200.0
    assert friction(800.0, 1.0, 0.015, **spot) == pytest.approx(800.0 + 400.0 * np.exp(-1.0), rel=1e-14)


def test_two_spots_add_up():
    """The second one has its own height and place; at one place both are one spot."""
    both = {"A_FR": 800.0, "h_FR": 0.5, "x_h": 0.01, "w_h": 0.002, "n_h": 0.0, "h_FR2": 0.25, **FLAT}

    assert friction(0.0, 1.0, 0.01, **both, x_h2=0.01) == pytest.approx(600.0, rel=1e-14)
    assert friction(0.0, 1.0, -0.03, **both, x_h2=-0.03) == pytest.approx(200.0, rel=1e-14)


def test_waves_have_no_level():
    """A period of 1 / n_h, a crest at x_h, a mean of zero."""
    x = np.linspace(0.0, 0.02, 1001)[:-1]
    waves = np.array([profile(at, 0.003, 1.0, 150.0) for at in x])

    assert profile(0.003 + 1.0 / 150.0, 0.003, 1.0, 150.0) == pytest.approx(1.0, rel=1e-12)
    assert profile(0.003 + 0.5 / 150.0, 0.003, 1.0, 150.0) == pytest.approx(-1.0, rel=1e-12)
    assert np.mean(waves) == pytest.approx(0.0, abs=1e-12)


def test_a_free_profile_is_the_exponential_of_a_cosine_series():
    """Of six terms over the range, constant beyond it, with a mean of zero; friction never pushes."""
    c = dict(zip(COEFFICIENTS, (0.3, -0.2, 0.1, 0.15, -0.05, 0.08), strict=True))
    x = -0.02 + 0.05 * (np.arange(1000) + 0.5) / 1000
    values = np.array([series(at, -0.02, 0.03, **c) for at in x])
    s = (x + 0.02) / 0.05

    expected = sum(size * np.cos(k * np.pi * s) for k, size in enumerate(c.values(), 1))
    np.testing.assert_allclose(values, expected, atol=1e-13)
    assert np.mean(values) == pytest.approx(0.0, abs=1e-13)
    assert series(0.04, -0.02, 0.03, **c) == pytest.approx(series(0.03, -0.02, 0.03, **c), rel=1e-14)
    spot = {"h_FR": 0.0, "x_h": 0.0, "w_h": 0.01, "n_h": 0.0, "h_FR2": 0.0, "x_h2": 0.0, "x_a": -0.02, "x_b": 0.03}
    relative = [friction(800.0, 1.0, at, 800.0, **spot, **c) / 800.0 for at in x]
    np.testing.assert_allclose(relative, np.exp(expected), rtol=1e-12)
    deep = {name: 20.0 * size for name, size in c.items()}
    assert min(friction(800.0, 1.0, at, 800.0, **spot, **deep) for at in x) == pytest.approx(40.0)
    assert friction(-800.0, -1.0, -0.02, 800.0, **spot, **c) == pytest.approx(-800.0 * np.exp(sum(c.values())))


@pytest.mark.parametrize("shape", [{"h_FR": -0.9, "h_FR2": -0.9}, {"h_FR": 5.0, "n_h": 100.0}])
def test_no_shape_pushes(shape):
    """Two loose spots at one place would leave less than no friction, and so would the troughs of high waves."""
    flat = {"h_FR": 0.0, "x_h": 0.0, "w_h": 0.01, "n_h": 0.0, "h_FR2": 0.0, "x_h2": 0.0, **FLAT}

    values = [friction(800.0, 1.0, at, 800.0, **{**flat, **shape}) for at in np.linspace(-0.03, 0.03, 601)]

    assert min(values) == pytest.approx(40.0)
