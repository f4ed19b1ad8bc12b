"""Residual tests of white residuals fail as rarely as they say, and see what is left by a wrong model."""

import numpy as np
import pytest
from scipy import signal, stats

from ehsa_ctrl.identification.residual_tests import LEVEL, band, correlations

N = 1000


@pytest.fixture(scope="module")
def against():
    """A drive that is noise, a direction that changes every quarter of a second, a position that drifts."""
    draws = np.random.default_rng(4)
    speed = np.convolve(draws.standard_normal(N + 59), np.ones(60), "valid")
    return {"current": draws.standard_normal(N), "sign(v)": np.sign(speed), "x": np.cumsum(speed)}


@pytest.mark.slow
def test_false_alarms_are_one_in_a_hundred(against):
    """Of 500 logs with white residuals in four channels about 5 fail one of 16 tests, though lags hang together."""
    draws = np.random.default_rng(5)
    alarms = sum(
        any(not test.passed for test in correlations(draws.standard_normal((N, 4)), tuple("abcd"), against))
        for _ in range(500)
    )

    low, high = stats.binom.ppf([0.001, 0.999], 500, 1.0 - LEVEL)
    assert alarms <= high
    # The bound is not so wide that nothing ever fails.
    assert alarms >= low / 3.0


@pytest.mark.parametrize(("neighbours", "least"), [(0.0, 0.045), (0.9, 0.035), (0.99, 0.015)])
def test_the_band_is_passed_as_often_as_asked(neighbours, least):
    """The largest of 26 numbers of a first-order chain, 20000 times: 5 % beyond the band, or less where they agree."""
    draws = np.random.default_rng(6).standard_normal((20_000, 26))
    draws[:, 1:] *= np.sqrt(1.0 - neighbours**2)
    chain = signal.lfilter([1.0], [1.0, -neighbours], draws, axis=1)

    passed = np.mean(np.max(np.abs(chain), axis=1) > band(neighbours, 26, 0.05))

    assert least < passed < 0.055


def test_numbers_that_are_all_the_same_count_once():
    """With full correlation the band is that of one number, without any it is Bonferroni's, nearly."""
    assert band(1.0, 26, 0.01) == pytest.approx(stats.norm.isf(0.005), abs=2e-3)
    assert band(0.0, 26, 0.01) == pytest.approx(stats.norm.isf(0.005 / 26), abs=2e-3)


def test_a_part_of_the_friction_that_is_missing_is_seen(against):
    """A fifth of the noise that goes with the direction fails that test, and its channel's alone."""
    white = np.random.default_rng(7).standard_normal((N, 2))
    white[:, 0] += 0.2 * against["sign(v)"]

    tests = {(test.channel, test.against): test for test in correlations(white, ("speed", "p1"), against)}

    assert not tests["speed", "sign(v)"].passed and tests["speed", "sign(v)"].outside > 0.1
    assert all(test.passed for (channel, _), test in tests.items() if channel == "p1")
