"""Innovations filter: residuals that are white for a right model although the logged input is noisy.

The logged current differs from the current that drove the motor by measurement noise. The rod's position integrates
this difference, so that after some seconds the simulation misses the position by more than its sensor's noise, with
strongly correlated errors. Ordinary least squares would count these as information. The linearised response to input
errors along a run is known (`simulation.sensitivity.transitions`), and a Kalman filter on these deviations turns
measured minus simulated, and each of its derivatives, into uncorrelated numbers of unit variance. Without input noise
it only divides by the sensors' noise, which is eq. (13) with weights.

Source: innovations form of the likelihood, L. Ljung, "System Identification: Theory for the User", 2nd ed., section
7.4, for the linearised error dynamics. Independent sensors allow to process the measurements one at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.compiled import cached_njit
from ..core.linear_recursion import add_product


class InnovationsFilter(NamedTuple):
    """The filter along one run, a fixed linear operator on sequences of measurements.

    by_state (N-1, n, n), by_input (N-1, n): transitions of the run. column (m,): state that a channel measures, scale
    (m,): its gain. gains (N, m, n), spread (N, m): filter gains and standard deviations of the innovations. input_sd:
    noise of the logged input.
    """

    by_state: np.ndarray
    by_input: np.ndarray
    column: np.ndarray
    scale: np.ndarray
    gains: np.ndarray
    spread: np.ndarray
    input_sd: float


def innovations_filter(
    by_state: np.ndarray, by_input: np.ndarray, column: np.ndarray, scale: np.ndarray, sd: np.ndarray, input_sd: float
) -> InnovationsFilter:
    """The filter along a run with these transitions, for channels with noise sd (m,); see InnovationsFilter."""
    by_state, by_input = np.ascontiguousarray(by_state), np.ascontiguousarray(by_input)
    gains, spread = _filter_gains(by_state, by_input, column, scale, sd, input_sd)
    return InnovationsFilter(by_state, by_input, column, scale, gains, spread, input_sd)


@cached_njit(nogil=True, error_model="numpy")
def _filter_gains(
    by_state: np.ndarray, by_input: np.ndarray, column: np.ndarray, scale: np.ndarray, sd: np.ndarray, input_sd: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gains (N, channels, n) and innovation standard deviations (N, channels) of the filter along a run.

    column (channels,): state that a channel measures, scale (channels,): its gain, sd (channels,): its noise. The
    initial state is treated as known, because it is estimated by its own derivatives.
    """
    samples, n, channels = by_state.shape[0] + 1, by_state.shape[1], column.size
    gains, spread = np.zeros((samples, channels, n)), np.empty((samples, channels))
    P, updated, variance = np.zeros((n, n)), np.zeros((n, n)), input_sd * input_sd
    for s in range(samples):
        for c in range(channels):
            state, h = column[c], scale[c]
            S = h * h * P[state, state] + sd[c] * sd[c]
            spread[s, c] = np.sqrt(S)
            if variance > 0.0:
                for i in range(n):
                    gains[s, c, i] = h * P[i, state] / S
                    for j in range(n):
                        updated[i, j] = P[i, j] - gains[s, c, i] * h * P[state, j]
                for i in range(n):
                    for j in range(n):
                        P[i, j] = 0.5 * (updated[i, j] + updated[j, i])
        if s + 1 < samples and variance > 0.0:
            moved = np.zeros((n, n))
            add_product(by_state[s], P, moved)
            for i in range(n):
                for j in range(n):
                    P[i, j] = variance * by_input[s, i] * by_input[s, j]
            add_product(moved, by_state[s].T, P)
    return gains, spread


@cached_njit(nogil=True, error_model="numpy")
def whiten(run: InnovationsFilter, values: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Innovations (N, channels, q), in standard deviations, of q independent sequences of measurements.

    errors (N,): input errors that the run already includes. Their expected value is zero, so that the first sequence,
    the residual, is expected to deviate by their effect. The other sequences are derivatives.
    """
    samples, channels, q = values.shape
    out, estimate = np.empty(values.shape), np.zeros((run.by_state.shape[1], q))
    for s in range(samples):
        for c in range(channels):
            for j in range(q):
                innovation = values[s, c, j] - run.scale[c] * estimate[run.column[c], j]
                out[s, c, j] = innovation / run.spread[s, c]
                for i in range(estimate.shape[0]):
                    estimate[i, j] += run.gains[s, c, i] * innovation
        if s + 1 < samples:
            moved = np.zeros(estimate.shape)
            add_product(run.by_state[s], estimate, moved)
            estimate = moved
            for i in range(estimate.shape[0]):
                estimate[i, 0] -= run.by_input[s, i] * errors[s]
    return out


@cached_njit(nogil=True)
def smooth_input_errors(run: InnovationsFilter, white: np.ndarray) -> np.ndarray:
    """Most probable input errors (N,), given the whitened residual (N, channels) of the whole run.

    Backward pass of the filter: the disturbance smoother of S. J. Koopman, Biometrika 80(1), 1993.
    """
    samples, channels = white.shape
    out, r = np.zeros(samples), np.zeros((run.by_state.shape[1], 1))
    for s in range(samples - 1, -1, -1):
        if s + 1 < samples:
            out[s] = run.input_sd * run.input_sd * np.sum(run.by_input[s] * r[:, 0])
            back = np.zeros(r.shape)
            add_product(run.by_state[s].T, r, back)
            r = back
        for c in range(channels - 1, -1, -1):
            total = white[s, c] / run.spread[s, c]
            for i in range(r.size):
                total -= run.gains[s, c, i] * r[i, 0]
            r[run.column[c], 0] += run.scale[c] * total
    return out
