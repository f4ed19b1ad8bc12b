"""Weights of residuals: closed forms of correlated noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ehsa_ctrl.diagnosis.scoring import MAX_WEIGHT, residual_weights


def test_correlated_residuals_count_less(rng):
    """A first-order process with coefficient a counts (1 - a) / (1 + a) of a white one of the same variance."""
    a = 0.9
    correlated = lfilter([np.sqrt(1 - a * a)], [1.0, -a], rng.normal(size=200_000)) * 2.0

    assert residual_weights(correlated[None, :], 0.008)[0] == pytest.approx((1 - a) / (1 + a) / 4.0, rel=0.1)


def test_no_residual_counts_more_than_the_most(rng):
    """However small residuals are: no model is assumed to be exact."""
    assert residual_weights(0.1 * rng.normal(size=(1, 5000)), 0.008)[0] == MAX_WEIGHT
