"""Mean and spread of a fleet against closed forms."""

import numpy as np
import pytest

from ehsa_ctrl.fleet import random_effects as module
from ehsa_ctrl.fleet.random_effects import random_effects


def balanced(random, units=30, spread=2.0, sd=1.5, mean=0.7):
    """One parameter, equally well known in each unit: estimates (units,) and their variance."""
    true = mean + spread * random.standard_normal(units)
    return true + sd * random.standard_normal(units), sd**2


def test_equally_known_units_have_the_closed_form():
    """Restricted maximum likelihood of a balanced one-way layout: sample variance minus that of an estimate."""
    estimates, variance = balanced(np.random.default_rng(1))

    found = random_effects(estimates[:, None] / variance, np.full((30, 1, 1), 1.0 / variance))

    between = np.var(estimates, ddof=1) - variance
    assert found.mean[0] == pytest.approx(np.mean(estimates), rel=1e-9)
    assert found.spread[0] == pytest.approx(np.sqrt(between), rel=1e-3)
    assert found.mean_sd[0] == pytest.approx(np.sqrt((between + variance) / 30), rel=1e-3)
    shrunk = np.mean(estimates) + between / (between + variance) * (estimates - np.mean(estimates))
    assert found.units[:, 0] == pytest.approx(shrunk, rel=1e-3, abs=1e-3)


def test_units_that_agree_have_no_spread():
    """Estimates that scatter less than their standard deviation."""
    estimates = 0.1 * np.sin(np.arange(20.0))

    found = random_effects(estimates[:, None], np.ones((20, 1, 1)))

    assert found.spread[0] < 0.05
    assert found.mean_sd[0] == pytest.approx(np.sqrt(1 / 20), rel=0.05)


def test_a_parameter_that_no_log_shows_is_not_determined():
    """And does not disturb one that is well known."""
    random = np.random.default_rng(2)
    estimates, variance = balanced(random)
    information = np.zeros((30, 2, 2))
    information[:, 0, 0] = 1.0 / variance

    both = random_effects(np.column_stack([estimates / variance, np.zeros(30)]), information)
    alone = random_effects(estimates[:, None] / variance, information[:, :1, :1])

    assert both.determined[1] == pytest.approx(0.0, abs=1e-9)
    assert both.spread[0] == pytest.approx(alone.spread[0], rel=1e-6)
    assert both.determined[0] > 10.0


def test_correlated_estimates_give_the_true_spreads():
    """Two parameters that trade off in each log, over many units."""
    random = np.random.default_rng(3)
    units, true = 400, np.array([1.0, 0.5])
    x = np.array([0.3, -0.2]) + true * random.standard_normal((units, 2))
    information = np.tile(4.0 * np.array([[1.0, 0.9], [0.9, 1.0]]), (units, 1, 1))
    noise = random.multivariate_normal(np.zeros(2), np.linalg.inv(information[0]), units)
    score = np.einsum("rij,rj->ri", information, x + noise)

    found = random_effects(score, information)

    assert found.spread == pytest.approx(true, rel=0.2)
    assert np.all(np.abs(found.mean - [0.3, -0.2]) < 4.0 * found.mean_sd)


def test_blocks_of_units_give_the_same_fleet(monkeypatch):
    """Thirty units at once, and in blocks of seven, the last of which is shorter."""
    random = np.random.default_rng(4)
    roots = random.standard_normal((30, 3, 3))
    score, information = random.standard_normal((30, 3)), roots @ roots.transpose(0, 2, 1)

    whole = random_effects(score, information)
    monkeypatch.setattr(module, "BLOCK", 7)
    parts = random_effects(score, information)

    for name in ("mean", "mean_sd", "spread", "units", "determined"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name), rel=1e-9, abs=1e-12)
