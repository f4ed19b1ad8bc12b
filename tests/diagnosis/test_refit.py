"""Refits on functions with known minima in place of simulations."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from ehsa_ctrl.diagnosis.objective import TEMPER
from ehsa_ctrl.diagnosis.refit import deviations_of, fit_on, refine, refit, refit_until_converged
from ehsa_ctrl.physics.effects import FreeNumber


class Valley:
    """Rosenbrock's function of k numbers as an objective; `costs` records that of every simulation."""

    def __init__(self, k, converged=1e-9):
        free = tuple(FreeNumber(f"z_{i}", 0.0, 1.0) for i in range(k))
        self.free, self.candidates, self.converged = free, (SimpleNamespace(free=free),), converged
        self.costs = []

    def free_numbers(self, candidates):
        return self.free

    def residuals(self, settings):
        found = []
        for setting in settings:
            z = np.array([setting[one.name] for one in self.free])
            found.append(np.concatenate([10.0 * (z[1:] - z[:-1] ** 2), 1.0 - z[:-1]]))
            self.costs.append(TEMPER * self.loss(found[-1]))
        return found

    def loss(self, r):
        return float(r @ r) / TEMPER

    def weights(self, r):
        return np.ones(r.size) / np.sqrt(TEMPER)

    def start(self):
        return {one.name: -1.2 if i % 2 == 0 else 1.0 for i, one in enumerate(self.free)}


@pytest.mark.parametrize("k", [2, 3])
def test_a_curved_valley_is_followed_to_its_minimum(k):
    """With the few rounds that a fit has."""
    valley = Valley(k)

    fit = refit_until_converged(valley, valley.candidates, valley.start())

    assert fit.cost < 1e-6
    assert list(fit.values.values()) == pytest.approx(k * [1.0], abs=1e-2)


def test_on_other_data_a_fit_keeps_all_of_its_numbers():
    """Also those that the other objective holds at their nominal values."""
    valley, other = Valley(3), Valley(3)
    fit = refit(valley, valley.candidates, valley.start(), {}, steps=2)
    other.free_numbers = lambda _: valley.free[:1]
    other.residuals = lambda settings: [np.append(r, r[0]) for r in valley.residuals(settings)]

    found = fit_on(other, fit)

    assert found.values == fit.values and found.free == fit.free
    assert found.residual == pytest.approx(np.append(fit.residual, fit.residual[0]), rel=1e-12)
    # Derivatives by the scale of each number, where the second residual is 10 (z_2 - z_1^2).
    assert found.jacobian.shape == (5, 3)
    assert found.jacobian[1, 2] == pytest.approx(10.0, rel=1e-6)


def test_a_round_ends_when_a_new_jacobian_pays_better():
    """Its last step is the first whose simulations gain less each than those before, with the Jacobian's."""
    valley, counted = Valley(8), []
    fit = refit(valley, valley.candidates, valley.start(), {}, steps=1)
    for _ in range(6):
        valley.costs.clear()
        before, fit = fit, refine(valley, fit, None)

        jacobian, tried = valley.costs[:8], valley.costs[8:]
        best = np.minimum.accumulate([before.cost, *tried])
        ends = [i for i, (one, other) in enumerate(pairwise(best), 1) if other < one]
        better = []
        for begin, end in pairwise([0, *ends]):
            gained, whole = best[begin] - best[end], best[0] - best[end]
            better.append(gained / (end - begin) >= whole / (len(jacobian) + end))
        assert better == [True] * (len(ends) - 1) + [False]
        assert fit.cost == pytest.approx(min(tried))
        counted.append(len(ends))
    assert max(counted) > 3


@pytest.mark.parametrize("k", [12, 14, 16])
def test_a_converging_fit_keeps_its_jacobian_while_that_pays(k):
    """It gets much further than with three steps for each Jacobian and as many simulations."""
    paying, by_three = Valley(k), Valley(k)
    refit_until_converged(paying, paying.candidates, paying.start())

    fit = refit(by_three, by_three.candidates, by_three.start(), {}, steps=3)
    while len(by_three.costs) < len(paying.costs) and not fit.settled:
        fit = refine(by_three, fit, 3)

    assert min(paying.costs) < 0.2 * min(by_three.costs[: len(paying.costs)])


def test_deviations_are_those_of_the_inverse():
    """Whatever the scales of the numbers."""
    scales = 10.0 ** np.arange(-6, 6, 3)
    J = np.random.default_rng(0).normal(size=(50, 4)) * scales

    expected = np.sqrt(np.diag(np.linalg.inv(J.T @ J / np.outer(scales, scales)))) / scales
    np.testing.assert_allclose(deviations_of(J.T @ J), expected, rtol=1e-9)


def test_what_the_data_show_nothing_of_has_an_infinite_deviation():
    """A column of zeros, and two that act alike, beside one of another size."""
    J = np.zeros((50, 4))
    J[:, :2] = np.random.default_rng(0).normal(size=(50, 2)) * [1.0, 1e5]
    J[:, 3] = -3.0 * J[:, 0]

    found = deviations_of(J.T @ J)

    assert np.isinf(found[[0, 2, 3]]).all()
    other = J[:, 1] - J[:, 0] * (J[:, 0] @ J[:, 1]) / (J[:, 0] @ J[:, 0])
    assert found[1] == pytest.approx(1.0 / np.linalg.norm(other))
