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

from dataclasses import dataclass

import numpy as np

from ..core.compiled import cached_njit
from ..simulation.sensitivity import Transitions


@dataclass(frozen=True)
class InnovationsFilter:
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

    @classmethod
    def along(
        cls, run: Transitions, column: np.ndarray, scale: np.ndarray, sd: np.ndarray, input_sd: float
    ) -> InnovationsFilter:
        """The filter for channels (m,) with noise sd (m,) and an input with noise input_sd."""
        by_state, by_input = np.ascontiguousarray(run.by_state), np.ascontiguousarray(run.by_input)
        gains, spread = filter_gains(by_state, by_input, column, scale, sd, input_sd)
        return cls(by_state, by_input, column, scale, gains, spread, input_sd)

    def whiten(self, values: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """(N, m, q) measurements to (N, m, q) standard deviations; errors (N,): input errors that the run includes."""
        return whiten(
            self.by_state, self.by_input, self.column, self.scale, self.gains, self.spread, values, errors
        )  # fmt: skip

    def input_errors(self, white: np.ndarray) -> np.ndarray:
        """Most probable input errors (N,), given the whitened residual (N, m)."""
        return smooth_input_errors(
            self.by_state, self.by_input, self.column, self.scale, self.gains, self.spread, white, self.input_sd
        )


@cached_njit(nogil=True)
def propagate_sensitivities(by_state: np.ndarray, by_parameter: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Derivatives of the states along a run (N, n, q + k), by q directions of the initial state and k parameters.

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

    column (channels,): state that a channel measures, scale (channels,): its gain, sd (channels,): its noise. The
    initial state is treated as known, because it is estimated by its own derivatives.
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
    """Innovations (N, channels, q), in standard deviations, of q independent sequences of measurements.

    errors (N,): input errors that the run already includes. Their expected value is zero, so that the first sequence,
    the residual, is expected to deviate by their effect. The other sequences are derivatives.
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
def smooth_input_errors(
    by_state: np.ndarray,
    by_input: np.ndarray,
    column: np.ndarray,
    scale: np.ndarray,
    gains: np.ndarray,
    spread: np.ndarray,
    white: np.ndarray,
    input_sd: float,
) -> np.ndarray:
    """Most probable input errors (N,), given the whitened residual (N, channels) of the whole run.

    Backward pass of the filter: the disturbance smoother of S. J. Koopman, Biometrika 80(1), 1993.
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
