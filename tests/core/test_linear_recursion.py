"""A recursion against its definition."""

import numpy as np
import pytest
import scipy.signal

from ehsa_ctrl.core.linear_recursion import constant_recursion, linear_recursion

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


def test_with_one_transition_a_course_is_that_of_a_state_space():
    """Against SciPy's simulation of a discrete system whose output is its state."""
    draws = np.random.default_rng(4)
    transition, added = 0.4 * draws.standard_normal((STATES, STATES)), draws.standard_normal((N, STATES))

    found = constant_recursion(transition, added)

    system = transition, np.eye(STATES), np.eye(STATES), np.zeros((STATES, STATES)), 1.0
    _, _, expected = scipy.signal.dlsim(system, added)
    assert found == pytest.approx(expected, rel=1e-10)


def test_a_course_without_samples_is_empty():
    assert constant_recursion(np.eye(STATES), np.zeros((0, STATES))).shape == (0, STATES)
