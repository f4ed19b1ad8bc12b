"""A recursion against its definition."""

import numpy as np
import pytest

from ehsa_ctrl.core.linear_recursion import linear_recursion

N, STATES = 40, 3


def test_courses_are_products_and_sums():
    """From the initial state the product of the transitions, from what is added the sum of what each sample adds."""
    draws = np.random.default_rng(9)
    transition = 0.4 * draws.standard_normal((N - 1, STATES, STATES))
    added, begin = draws.standard_normal((N - 1, STATES, 2)), np.eye(STATES)[:, :1]

    found = linear_recursion(transition, added, begin)

    states = [np.hstack([begin, np.zeros((STATES, 2))])]
    for s in range(N - 1):
        states.append(transition[s] @ states[-1] + np.hstack([np.zeros((STATES, 1)), added[s]]))
    assert found == pytest.approx(np.stack(states), rel=1e-10)
