"""The regression behind the balances: filters of both sides, and least squares with correlated residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..core.errors import InputError
from ..core.log import Log
from ..core.text import join_words
from ..core.unit import unit_suffix
from ..plant.system import ParameterKind
from .balance_signals import Method

#: A parameter with a larger relative standard deviation is not determined.
VAGUE = 0.5
#: Columns of unit size are linearly dependent below this ratio of the singular values: rounding is near 1e-15.
#: Engineering judgement.
DEPENDENT = 1e-9
#: Reason to take a parameter as known where all terms of a balance have a free parameter.
RATIO = "only its ratio to the others is determined"
#: Length of a test function in samples, and the distance to the next.
TEST_SAMPLES, STRIDE = 12, 4
#: Order of the low-pass filters, and the sampling frequency after decimation as a multiple of the low-pass: rows at a
#: higher rate would repeat each other.
ORDER, DECIMATED = 4, 2.5


@dataclass(frozen=True)
class RowFilter:
    """Filter of both sides of a balance: (values (N, k), usable (N,)) -> rows; `lags`: number of overlapping rows."""

    test_function: np.ndarray | None
    sos: np.ndarray | None
    stride: int
    lags: int

    def __call__(self, values: np.ndarray, usable: np.ndarray) -> np.ndarray:
        if self.test_function is not None:
            windows, length = np.lib.stride_tricks.sliding_window_view, self.test_function.size
            fine = windows(usable, length)[:: self.stride].all(axis=1)
            return np.asarray(windows(values, length, axis=0)[:: self.stride][fine] @ self.test_function)
        if self.sos is not None:
            values = sosfiltfilt(self.sos, values, axis=0)
        return np.asarray(values[:: self.stride][usable[:: self.stride]])


def row_filter(log: Log, method: Method, width: float | None, parallel: float | None) -> RowFilter:
    dt = log.sample_time
    if method == "weak":
        samples = TEST_SAMPLES if width is None else int(round(width / dt))
        if not 3 <= samples <= len(log) // 4:
            raise InputError(
                f"{log.path or 'the log'}: test functions of {samples} samples do not fit a log of {len(log)} samples; "
                "expected at least 3 samples and at most a quarter of the log"
            )
        weights = np.sin(np.pi * (np.arange(samples) + 0.5) / samples) ** 2
        stride = max(samples * STRIDE // TEST_SAMPLES, 1)
        return RowFilter(weights / weights.sum(), None, stride, samples // stride)
    if parallel is None:
        return RowFilter(None, None, 1, 10)
    if not 0.0 < parallel < 0.5 / dt:
        raise InputError(f"parallel = {parallel:g} Hz; expected more than 0 and less than {0.5 / dt:g} Hz")
    stride = max(int(round(1.0 / (DECIMATED * parallel * dt))), 1)
    return RowFilter(None, butter(ORDER, parallel, fs=1.0 / dt, output="sos"), stride, 2)


def solve_balance(
    X: np.ndarray, y: np.ndarray, nominal: np.ndarray, kinds: Sequence[ParameterKind], term: np.ndarray, lags: int
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Least squares of y + X values = 0, without the parameters that the rows don't determine, dropped one by one.

    Returns values (k,), nominal where dropped, their standard deviations (k,), and the reasons for dropping.
    """
    values, sd = nominal.copy(), np.full(nominal.size, np.nan)
    reasons = [""] * nominal.size
    size = np.sqrt(np.mean(X**2, axis=0)) if nominal.size else np.zeros(0)
    level = float(np.sqrt(np.mean(term**2)))
    while True:
        active = [i for i in range(nominal.size) if not reasons[i]]
        if not active:
            return values, sd, reasons
        dropped = [i for i in range(nominal.size) if reasons[i]]
        constant = y + X[:, dropped] @ values[dropped]
        silent = [i for i in active if size[i] * max(abs(nominal[i]), 1e-300) == 0.0]
        if silent:
            reasons[silent[0]] = "has no effect in these records"
            continue
        if np.sqrt(np.mean(constant**2)) < 1e-9 * max(level, 1e-300):
            # Everything known is zero: only ratios are determined, so the largest term is taken as known.
            reasons[max(active, key=lambda i: size[i] * abs(nominal[i]))] = RATIO
            continue
        alike = _collinear(X[:, active] / size[active])
        if len(alike) > 1:
            # The last of them keeps its nominal value.
            *others, last = (active[i] for i in alike)
            reasons[last] = f"these records can't tell it from {join_words([kinds[i].name for i in others])}"
            values[last], sd[last] = nominal[last], np.nan
            continue
        scale = size[active]
        found, spread = _least_squares(X[:, active] / scale, -constant, lags)
        values[active], sd[active] = found / scale, spread / scale
        relative_sd = {}
        for i in active:
            natural = abs(values[i]) if kinds[i].lower >= 0.0 else level / size[i]
            relative_sd[i] = sd[i] / max(natural, 1e-300)
            if not kinds[i].lower <= values[i] <= kinds[i].upper or (kinds[i].lower_open and values[i] <= 0.0):
                relative_sd[i] = np.inf
        worst = max(relative_sd, key=lambda i: relative_sd[i])
        if relative_sd[worst] <= VAGUE:
            return values, sd, reasons
        reasons[worst] = (
            f"{values[worst]:.3g}{unit_suffix(kinds[worst].unit)} would be impossible"
            if relative_sd[worst] == np.inf
            else f"its standard deviation is {100 * relative_sd[worst]:.0f} %"
        )
        values[worst], sd[worst] = nominal[worst], np.nan


def _collinear(X: np.ndarray) -> list[int]:
    """Columns of X (n, k) that are linearly dependent on each other; empty if none are."""
    _, singular, directions = np.linalg.svd(X, full_matrices=False)
    if singular[-1] > DEPENDENT * singular[0]:
        return []
    part = np.abs(directions[-1])
    return np.flatnonzero(part > 0.1 * part.max()).tolist()


def _least_squares(X: np.ndarray, y: np.ndarray, lags: int) -> tuple[np.ndarray, np.ndarray]:
    """Solution (k,) and its standard deviations (k,), by Newey and West for residuals correlated over some rows."""
    inverse = np.linalg.pinv(X.T @ X, hermitian=True)
    solution: np.ndarray = np.linalg.lstsq(X, y, rcond=None)[0]
    scores = X * (y - X @ solution)[:, None]
    middle = scores.T @ scores
    reach = max(2 * lags, int(np.ceil(4.0 * (y.size / 100.0) ** (2.0 / 9.0))))
    for lag in range(1, min(reach, y.size - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (reach + 1.0)) * (cross + cross.T)
    return solution, np.sqrt(np.maximum(np.diag(inverse @ middle @ inverse), 0.0))
