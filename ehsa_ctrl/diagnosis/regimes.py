"""The variables on which an unknown input depends, found without the catalogue of effects.

Regressors and unknown input are averaged over short windows. Each curve is fitted on half of the intervals of 0.5 s and
validated on the other half, and vice versa: state-dependent parameter estimation (P. C. Young, "Recursive Estimation
and Time-Series Analysis", Springer 2011) in its simplest form, with cross-validation.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ..plant.plant import Plant
from .regressors import (
    NONLINEAR,
    Regressors,
    drive_regressors,
    flow_regressors,
    force_regressors,
    shaft_angle,
    torque_regressors,
)
from .unknown_inputs import UNITS, BalanceSignals, fill_nan

# The numbers below are engineering judgement.

#: Length of a window and stride to the next, in samples; length of the intervals for cross-validation [s].
WINDOW, STRIDE, INTERVAL = 12, 3, 0.5
#: Penalty on each parameter of a curve beyond the first, as a share of the unknown input's square.
PENALTY = 0.001
#: Smallest number of windows for a fit.
MIN_WINDOWS = 40
#: Ridge relative to the mean square of a regressor: bounds the coefficients of regressors that are hardly excited.
RIDGE = 1e-3
#: Highest order of a ripple that is tried, in periods per turn of the shaft.
HIGHEST_ORDER = 24


CurveKey = tuple[str, str, str]


@dataclass(frozen=True)
class Curve:
    """An unknown input as a function of a variable.

    values: (N - 1,) fitted unknown input. explained: share of the unknown input's square that it explains, by
    cross-validation, minus a penalty per parameter. numbers: of free parameters. family, against, unit, variable,
    number, sign: see `Regressors`.
    """

    unknown_input: str
    family: str
    against: str
    unit: str
    variable: np.ndarray
    values: np.ndarray
    explained: float
    numbers: int
    number: float = float("nan")
    sign: np.ndarray | None = None

    def over(self, part: slice) -> Curve:
        """The same curve over a part of the samples."""
        sign = None if self.sign is None else self.sign[part]
        return replace(self, values=self.values[part], variable=self.variable[part], sign=sign)

    @property
    def key(self) -> CurveKey:
        """What identifies it among the curves of a log."""
        return self.unknown_input, self.family, self.against


class Windows:
    """Weighted means of an unknown input over windows in which it is known.

    values, centres, fold: (windows,) mean, time [s] and fold of each window. span: samples from the first window to the
    last. longer: factor on length, stride and interval.
    """

    def __init__(
        self, values: np.ndarray, sample_time: float, fitted: np.ndarray | None = None, *, longer: int = 1
    ) -> None:
        self._window, self._stride = longer * WINDOW, longer * STRIDE
        weights = np.sin(np.pi * (np.arange(self._window) + 0.5) / self._window) ** 2
        self._weights = weights / weights.sum()
        usable = self._means(np.isfinite(values).astype(float)) > 1.0 - 1e-9
        if fitted is not None and usable.size:
            parts = np.lib.stride_tricks.sliding_window_view(fitted, self._window)
            usable &= parts[:: self._stride].all(axis=1)
        used = np.flatnonzero(usable)
        first, last = (int(used[0]), int(used[-1])) if used.size else (0, -1)
        self._usable = usable[first : last + 1]
        self.span = slice(self._stride * first, self._stride * last + self._window if used.size else 0)
        self.values = self.over_span(fill_nan(values)[self.span])
        self.centres = self._stride * used * sample_time
        self.fold = (self.centres // (longer * INTERVAL)).astype(int) % 2

    def _means(self, values: np.ndarray) -> np.ndarray:
        # A window is a whole number of strides. Sums over strides are much faster than products of overlapping windows.
        parts = self._window // self._stride
        rows = values[: values.size // self._stride * self._stride].reshape(-1, self._stride)
        sums = rows @ self._weights.reshape(parts, self._stride).T
        count = max(len(rows) - parts + 1, 0)
        return np.asarray(sum(sums[i : i + count, i] for i in range(parts)))

    def of(self, columns: np.ndarray) -> np.ndarray:
        """Columns (N - 1, k) averaged over the same windows."""
        found = [self.over_span(column[self.span]) for column in columns.T]
        return np.column_stack(found) if found else np.zeros((self.values.size, 0))

    def over_span(self, values: np.ndarray) -> np.ndarray:
        """Values at the samples of `span` averaged over the same windows."""
        return self._means(values)[self._usable]

    def reversed(self) -> Windows:
        """The same windows with the unknown input reversed in time."""
        other = copy(self)
        other.values = self.values[::-1]
        return other

    def fit(self, x: Regressors, unknown_input: str) -> Curve | None:
        """The best curve with these regressors; None if there are too few windows."""
        X, y = self.of(x.columns), self.values
        if x.fixed:
            left = y - X[:, 0]
            values = x.columns[:, 0]
        else:
            left = np.empty_like(y)
            for fold in (0, 1):
                train, test = self.fold != fold, self.fold == fold
                if train.sum() < 2 * X.shape[1] + 5:
                    return None
                left[test] = y[test] - X[test] @ _ridge(X[train], y[train])
            values = x.columns @ _ridge(X, y)
            # Extrapolation beyond the fitted windows is bounded.
            low, high = np.quantile(y, [0.002, 0.998])
            values = np.clip(values, 1.3 * min(low, 0.0), 1.3 * max(high, 0.0))
        total = float(y @ y)
        explained = 1.0 - float(left @ left) / total if total > 0.0 else 0.0
        explained -= PENALTY * (X.shape[1] - 1)
        return Curve(
            unknown_input, x.family, x.against, x.unit, x.variable, values, explained, X.shape[1], x.number, x.sign
        )


def _ridge(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least-squares coefficients (k,) of X (n, k) and y (n,), with a ridge."""
    size = np.sqrt(np.mean(X**2, axis=0)) + 1e-300
    G = (X / size).T @ (X / size) / len(y)
    return np.asarray(np.linalg.solve(G + RIDGE * np.eye(len(G)), (X / size).T @ y / len(y)) / size)


def curves_of(
    plant: Plant, signals: BalanceSignals, name: str, values: np.ndarray, fitted: np.ndarray | None = None
) -> list[Curve]:
    """The best curve of each family and variable for an unknown input (N - 1,); that which explains most first.

    fitted: (N - 1,) samples that the curves may be fitted to; by default all.
    """
    windows = Windows(values, signals.sample_time, fitted)
    if windows.values.size < MIN_WINDOWS:
        return []
    if name == "torque":
        candidates = torque_regressors(plant, signals, _ripple_orders(windows, plant, signals))
    elif name == "force":
        candidates = force_regressors(plant, signals)
    else:
        candidates = flow_regressors(plant, signals, name, _ripple_orders(windows, plant, signals))
    best = _best_of_each(candidates, windows, name, {})
    for curve in [c for c in best.values() if c.family in NONLINEAR and c.explained > 0.3]:
        finer = curve.number * np.array([0.8, 0.87, 0.94, 1.07, 1.14, 1.23])
        best = _best_of_each(drive_regressors(plant, signals, curve.family, finer), windows, name, best)
    return sorted(best.values(), key=lambda curve: -curve.explained)


def _best_of_each(
    candidates: list[Regressors], windows: Windows, name: str, known: dict[CurveKey, Curve]
) -> dict[CurveKey, Curve]:
    best = dict(known)
    for curve in (windows.fit(x, name) for x in candidates):
        if curve is not None and (curve.key not in best or curve.explained > best[curve.key].explained):
            best[curve.key] = curve
    return best


def _ripple_orders(windows: Windows, plant: Plant, signals: BalanceSignals, count: int = 2) -> tuple[float, ...]:
    """The dominant orders of a ripple, in periods per turn of the shaft."""
    angle = shaft_angle(plant, signals)
    gains = []
    for order in range(1, HIGHEST_ORDER + 1):
        X = windows.of(np.column_stack([np.sin(order * angle), np.cos(order * angle)]))
        a = _ridge(X, windows.values)
        gains.append((float(np.sum((X @ a) ** 2)), float(order)))
    return tuple(order for _, order in sorted(gains, reverse=True)[:count])


@dataclass(frozen=True)
class Regime:
    """Dependence of an unknown input on a variable.

    Attributes
    ----------
    balance: "torque", "flow_1", "flow_2" or "force".
    against, unit: the variable, in words.
    bins: (k,) mean of the variable in each bin.
    mean, sd: (k,) mean and standard deviation of the unknown input in each bin, SI units. Multiplied by the sign of the
        motion for a variable "against the motion", and by the sign of the other variable for one "with" it.
    explained: share of the unknown input's square that the curve explains on data that was not fitted.
    words: the dependence in one line.
    gap_closed: share of the squared gap that this curve alone closes; nan if it was not simulated.
    which: (N - 1,) number of the bin that each sample lies in, 1 for the first; 0 where the input is not known.
    """

    balance: str
    against: str
    unit: str
    bins: np.ndarray = field(repr=False)
    mean: np.ndarray = field(repr=False)
    sd: np.ndarray = field(repr=False)
    explained: float
    words: str
    gap_closed: float = float("nan")
    which: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int), repr=False)

    def __str__(self) -> str:
        return f"{self.balance}: {self.words}"


def regime_of(curve: Curve, values: np.ndarray, gap_closed: float = float("nan"), bins: int = 15) -> Regime:
    """The regime of a curve, with the unknown input (N - 1,) averaged in bins of the variable."""
    z = curve.variable
    if curve.sign is not None:
        values = values * curve.sign
    known = np.isfinite(values)
    edges = np.unique(np.quantile(z[known], np.linspace(0.0, 1.0, bins + 1)))
    if curve.family in ("sign", "sides"):
        edges = np.array([-1.5, 0.0, 1.5])
    if edges.size < 2:
        edges = np.array([edges[0] - 0.5, edges[0] + 0.5])
    which = np.clip(np.searchsorted(edges, z, "right") - 1, 0, edges.size - 2)
    rows = [(which == k) & known for k in range(edges.size - 1)]
    rows = [row for row in rows if row.any()]
    middle = np.array([float(np.mean(z[row])) for row in rows])
    mean = np.array([float(np.mean(values[row])) for row in rows])
    sd = np.array([float(np.std(values[row])) for row in rows])
    numbers = sum((k * row for k, row in enumerate(rows, 1)), np.zeros(z.size, dtype=int))
    explained = float(np.clip(curve.explained, 0.0, 1.0))
    return Regime(
        curve.unknown_input, curve.against, curve.unit, middle, mean, sd, explained, describe_curve(curve), gap_closed,
        numbers,
    )  # fmt: skip


def describe_curve(curve: Curve) -> str:
    """The curve in one line."""
    unit = UNITS[curve.unknown_input]
    name = {"torque": "torque error", "force": "force error"}.get(
        curve.unknown_input, f"error of the flow into chamber {curve.unknown_input[-1]}"
    )
    size = float(np.sqrt(np.mean(curve.values**2)))
    drive = curve.against.removeprefix("changes of ")
    plain = {
        "constant": f"{name} of {np.mean(curve.values):.3g} {unit}, constant",
        "sign": f"{name} of {size:.3g} {unit} with {curve.against}",
        "delay": f"like a delay of {drive} of {1e3 * curve.number:.2g} ms",
        "lag": f"like a lag of {drive} with a time constant of {1e3 * curve.number:.2g} ms",
        "rate limit": f"like a rate limit of {drive} of {curve.number:.3g} {curve.unit}/s",
        "dead band": f"like a dead band of the drive of +-{curve.number:.2g} {curve.unit}",
    }
    if curve.family in plain:
        return plain[curve.family]
    if curve.family in ("linear", "rate", "gain"):
        slope = float(curve.values @ curve.variable) / max(float(curve.variable @ curve.variable), 1e-300)
        return f"{name} of {size:.3g} {unit} proportional to {curve.against}, {slope:.3g} {unit} per {curve.unit}"
    if curve.family == "time":
        return _describe_in_time(curve, name, unit)
    if curve.family in ("signed position", "position"):
        where = _localised_range(curve)
        if where:
            side = ", against the motion" if curve.family == "signed position" else ""
            return f"{name} of up to {float(np.max(np.abs(curve.values))):.3g} {unit}{side}, {where}"
    return f"{name} of {size:.3g} {unit} that depends on {curve.against}"


def _describe_in_time(curve: Curve, name: str, unit: str) -> str:
    """A function of time in one line: a step at an instant, or a drift."""
    y, n = curve.values, curve.values.size
    sums = np.cumsum(y)
    k = np.arange(n // 20, n - n // 20)
    before, after = sums[k] / (k + 1.0), (sums[-1] - sums[k]) / (n - 1.0 - k)
    gain = (k + 1.0) * before**2 + (n - 1.0 - k) * after**2 - n * np.mean(y) ** 2
    best = int(np.argmax(gain))
    if gain[best] > 0.8 * n * float(np.var(y)) and abs(before[best]) < 0.2 * abs(after[best]):
        return f"{name} of {after[best]:.3g} {unit} from {curve.variable[k[best]]:.1f} s on"
    return f"{name} of {float(np.sqrt(np.mean(y**2))):.3g} {unit} that drifts with time"


def _localised_range(curve: Curve) -> str:
    """The range of positions in which a curve is much larger than elsewhere, in words; empty if there is none."""
    size = np.abs(curve.values)
    large = size > 0.5 * float(np.quantile(size, 0.995))
    if not 0.01 < float(np.mean(large)) < 0.3:
        return ""
    low, high = np.quantile(curve.variable[large], [0.1, 0.9])
    first, last = np.quantile(curve.variable, [0.02, 0.98])
    if high - low > 0.3 * (last - first):
        return ""
    if high >= last or low <= first:
        return f"mostly beyond x = {1e3 * (low if high >= last else high):.0f} mm"
    return f"only around x = {1e3 * float(np.median(curve.variable[large])):.0f} mm"
