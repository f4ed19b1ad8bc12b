"""Figures of a table: shares with Wilson intervals, means and medians with bootstrap intervals, 95 %."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, bootstrap


@dataclass(frozen=True)
class Figure:
    """One line of the table. `count`: number of cases of the share or mean."""

    label: str
    value: float
    low: float
    high: float
    count: int
    kind: str = "share"

    def text(self) -> str:
        if self.count == 0:
            return f"| {self.label} | - | - | 0 |"
        percent = self.kind == "share"
        one: Callable[[float], str] = (lambda v: f"{100 * v:.1f} %") if percent else (lambda v: f"{v:.3g}")
        return f"| {self.label} | {one(self.value)} | {one(self.low)} to {one(self.high)} | {self.count} |"


def share(label: str, hits: Sequence[bool]) -> Figure:
    n, k = len(hits), sum(map(bool, hits))
    if n == 0:
        return Figure(label, float("nan"), float("nan"), float("nan"), 0)
    interval = binomtest(k, n).proportion_ci(method="wilson")
    return Figure(label, k / n, float(interval.low), float(interval.high), n)


def centre(label: str, values: Sequence[float | None], of: Callable[..., np.floating] = np.mean) -> Figure:
    y = np.array([v for v in values if v is not None and np.isfinite(v)])
    if y.size == 0:
        return Figure(label, float("nan"), float("nan"), float("nan"), 0, "number")
    value = float(of(y))
    if y.size < 3 or np.ptp(y) == 0.0:
        return Figure(label, value, value, value, y.size, "number")
    interval = bootstrap((y,), of, n_resamples=1000, method="percentile", rng=np.random.default_rng(0))
    low, high = interval.confidence_interval
    return Figure(label, value, float(low), float(high), y.size, "number")


def skill(label: str, answered: np.ndarray, guessed: np.ndarray) -> Figure:
    """1 - loss / loss of guessing, over all cases; the interval draws cases."""

    def of(a: np.ndarray, b: np.ndarray) -> float:
        return float(1.0 - np.sum(a) / np.sum(b))

    value = of(answered, guessed)
    if answered.size < 3 or np.ptp(answered - guessed * (1.0 - value)) < 1e-12:
        return Figure(label, value, value, value, answered.size, "number")
    interval = bootstrap(
        (answered, guessed), of, paired=True, vectorized=False, n_resamples=1000, method="percentile", rng=1
    ).confidence_interval
    return Figure(label, value, float(interval.low), float(interval.high), answered.size, "number")
