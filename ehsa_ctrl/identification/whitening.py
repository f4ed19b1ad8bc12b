"""Residuals that are white when the model is right, although the logged current is not the current that acted.

The current that a log holds differs from the one that turned the motor by the noise of its measurement. The rod's
position integrates that difference, so that after some seconds the simulation misses it by more than the position
sensor's noise, and neighbouring samples miss it alike. Ordinary least squares takes this for information. Along a
simulated run the response to errors of the input is known (`simulation.sensitivity.transitions`); a Kalman filter on
these deviations turns measured minus simulated, and every derivative of it, into uncorrelated numbers of variance
one. Without noise on the input it divides by the sensors' noise and nothing else, which is (13) with weights.

Source: the innovations form of the likelihood, as in L. Ljung, "System Identification: Theory for the User", 2nd ed.,
section 7.4, here for the linearised error dynamics; measurements are taken one at a time, which is the same for
independent sensors.
"""

from __future__ import annotations

import numpy as np

from ..core.compiled import cached_njit


@cached_njit(nogil=True)
def accumulate(by_state: np.ndarray, by_parameter: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Derivatives of the states along a run, (N, n, q + k): by q directions of the initial state, by k parameters.

    by_state (N-1, n, n), by_parameter (N-1, n, k), begin (n, q).
    """
    samples, n, k = by_parameter.shape[0] + 1, begin.shape[0], by_parameter.shape[2]
    q = begin.shape[1]
    out = np.zeros((samples, n, q + k))
    for i in range(n):
        for j in range(q):
            out[0, i, j] = begin[i, j]
    for s in range(samples - 1):
        for i in range(n):
            for j in range(q + k):
                total = by_parameter[s, i, j - q] if j >= q else 0.0
                for m in range(n):
                    total += by_state[s, i, m] * out[s, m, j]
                out[s + 1, i, j] = total
    return out


@cached_njit(nogil=True)
def filter_gains(
    by_state: np.ndarray, by_input: np.ndarray, column: np.ndarray, scale: np.ndarray, sd: np.ndarray, input_sd: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gains (N, channels, n) and innovation standard deviations (N, channels) of the filter along a run.

    column (channels,): the state that a channel measures, scale (channels,): its gain, sd (channels,): its noise.
    The initial deviation is taken as known: it has derivatives of its own.
    """
    samples, n, channels = by_state.shape[0] + 1, by_state.shape[1], column.size
    gains = np.zeros((samples, channels, n))
    spread = np.empty((samples, channels))
    P = np.zeros((n, n))
    half = np.zeros((n, n))
    variance = input_sd * input_sd
    for s in range(samples):
        for c in range(channels):
            state, h = column[c], scale[c]
            S = h * h * P[state, state] + sd[c] * sd[c]
            spread[s, c] = np.sqrt(S)
            if variance > 0.0:
                for i in range(n):
                    gains[s, c, i] = h * P[i, state] / S
                for i in range(n):
                    for j in range(n):
                        half[i, j] = P[i, j] - gains[s, c, i] * h * P[state, j]
                for i in range(n):
                    for j in range(n):
                        P[i, j] = 0.5 * (half[i, j] + half[j, i])
        if s + 1 < samples and variance > 0.0:
            for i in range(n):
                for j in range(n):
                    total = 0.0
                    for m in range(n):
                        total += by_state[s, i, m] * P[m, j]
                    half[i, j] = total
            for i in range(n):
                for j in range(n):
                    total = variance * by_input[s, i] * by_input[s, j]
                    for m in range(n):
                        total += half[i, m] * by_state[s, j, m]
                    P[i, j] = total
    return gains, spread


@cached_njit(nogil=True)
def whiten(
    by_state: np.ndarray,
    by_input: np.ndarray,
    column: np.ndarray,
    scale: np.ndarray,
    gains: np.ndarray,
    spread: np.ndarray,
    values: np.ndarray,
    errors: np.ndarray,
) -> np.ndarray:
    """Filter sequences of measurements (N, channels, q), each by itself: (N, channels, q) in standard deviations.

    errors (N,): what the run has already taken for errors of the input; they are expected to be zero, so that the
    first sequence, the residual, is expected to deviate by as much. Other sequences are derivatives.
    """
    samples, channels, q = values.shape
    n = by_state.shape[1]
    out = np.empty((samples, channels, q))
    estimate = np.zeros((n, q))
    moved = np.zeros((n, q))
    for s in range(samples):
        for c in range(channels):
            state, h = column[c], scale[c]
            for j in range(q):
                surprise = values[s, c, j] - h * estimate[state, j]
                out[s, c, j] = surprise / spread[s, c]
                for i in range(n):
                    estimate[i, j] += gains[s, c, i] * surprise
        if s + 1 < samples:
            for i in range(n):
                for j in range(q):
                    total = 0.0
                    for m in range(n):
                        total += by_state[s, i, m] * estimate[m, j]
                    moved[i, j] = total
            for i in range(n):
                for j in range(q):
                    estimate[i, j] = moved[i, j]
                estimate[i, 0] -= by_input[s, i] * errors[s]
    return out


@cached_njit(nogil=True)
def input_errors(
    by_state: np.ndarray,
    by_input: np.ndarray,
    column: np.ndarray,
    scale: np.ndarray,
    gains: np.ndarray,
    spread: np.ndarray,
    white: np.ndarray,
    input_sd: float,
) -> np.ndarray:
    """The most probable errors (N,) of the input, given the whitened residual (N, channels) of the whole run.

    The filter's sweep backwards: the disturbance smoother of S. J. Koopman, Biometrika 80(1), 1993.
    """
    samples, channels = white.shape
    n = by_state.shape[1]
    out = np.zeros(samples)
    r = np.zeros(n)
    back = np.zeros(n)
    for s in range(samples - 1, -1, -1):
        if s + 1 < samples:
            total = 0.0
            for i in range(n):
                total += by_input[s, i] * r[i]
            out[s] = input_sd * input_sd * total
            for j in range(n):
                total = 0.0
                for i in range(n):
                    total += by_state[s, i, j] * r[i]
                back[j] = total
            for j in range(n):
                r[j] = back[j]
        for c in range(channels - 1, -1, -1):
            state, h = column[c], scale[c]
            total = white[s, c] / spread[s, c]
            for i in range(n):
                total -= gains[s, c, i] * r[i]
            r[state] += h * total
    return out
