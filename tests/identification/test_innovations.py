"""The filter against the dense covariance that it stands for."""

import numpy as np
import pytest

from ehsa_ctrl.identification.innovations import innovations_filter, smooth_input_errors, whiten

N, STATES, COLUMN = 40, 3, np.array([0, 2])
SCALE, SD, INPUT_SD = np.array([1.5, 1.0]), np.array([0.3, 0.2]), 0.7


@pytest.fixture
def chain():
    """A random stable chain of samples: by_state, by_input."""
    draws = np.random.default_rng(3)
    by_state = 0.5 * draws.standard_normal((N - 1, STATES, STATES)) / np.sqrt(STATES) + 0.6 * np.eye(STATES)
    return by_state, draws.standard_normal((N - 1, STATES))


def response(chain):
    """Measurements (N * channels, N - 1) by the error of each input."""
    by_state, by_input = chain
    G = np.zeros((N, COLUMN.size, N - 1))
    for j in range(N - 1):
        state = by_input[j].copy()
        for s in range(j + 1, N):
            G[s, :, j] = SCALE * state[COLUMN]
            if s < N - 1:
                state = by_state[s] @ state
    return G.reshape(-1, N - 1)


def covariance(chain):
    G = response(chain)
    return INPUT_SD**2 * G @ G.T + np.diag(np.tile(SD**2, N))


def test_whitened_squares_are_those_of_the_dense_covariance(chain):
    """The sum of squares is e' C^-1 e, and the innovations' variances multiply to det C."""
    e = np.random.default_rng(5).standard_normal((N, COLUMN.size, 2))
    C = covariance(chain)

    run = innovations_filter(*chain, COLUMN, SCALE, SD, INPUT_SD)
    white = whiten(run, e, np.zeros(N))

    for q in range(2):
        flat = e[:, :, q].ravel()
        assert np.sum(white[:, :, q] ** 2) == pytest.approx(flat @ np.linalg.solve(C, flat), rel=1e-9)
    assert 2 * np.sum(np.log(run.spread)) == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-9)


def test_smoothed_input_errors_are_the_conditional_mean(chain):
    """The backward sweep gives q G' C^-1 e."""
    e = np.random.default_rng(6).standard_normal((N, COLUMN.size, 1))
    expected = INPUT_SD**2 * response(chain).T @ np.linalg.solve(covariance(chain), e.ravel())

    run = innovations_filter(*chain, COLUMN, SCALE, SD, INPUT_SD)
    white = whiten(run, e, np.zeros(N))[:, :, 0]
    found = smooth_input_errors(run, white)

    assert found[:-1] == pytest.approx(expected, rel=1e-8, abs=1e-12)
    assert found[-1] == 0.0


def test_a_residual_from_the_input_errors_of_the_run_whitens_to_zero(chain):
    """A residual that is nothing but the response to -w whitens to zero when the run holds w."""
    w = np.random.default_rng(7).standard_normal(N)
    e = -(response(chain) @ w[:-1]).reshape(N, COLUMN.size, 1)

    run = innovations_filter(*chain, COLUMN, SCALE, SD, INPUT_SD)
    white = whiten(run, e, w)

    assert white == pytest.approx(np.zeros_like(white), abs=1e-9)


def test_without_noise_on_the_input_it_divides_by_the_sensors_noise(chain):
    """Then nothing is filtered: eq. (13) with weights."""
    e = np.random.default_rng(8).standard_normal((N, COLUMN.size, 1))

    run = innovations_filter(*chain, COLUMN, SCALE, SD, 0.0)
    white = whiten(run, e, np.zeros(N))

    assert np.array_equal(white[:, :, 0], e[:, :, 0] / SD)
