"""Curves that an unknown input follows, found without a catalogue of effects, and the regimes that they show.

Regressors are fitted to the unknown input, both averaged over short windows, on every second half of a second and
validated on the others: state dependent parameter estimation with cross-validation (P. C. Young, "Recursive Estimation
and Time-Series Analysis", Springer 2011) in its simplest form.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..plant.plant import Plant
from .regressors import (
    FITTED,
    Regressors,
    drive_regressors,
    flow_regressors,
    force_regressors,
    shaft_angle,
    torque_regressors,
)
from .unknown_inputs import UNITS, BalanceSignals, filled

#: Length of a window and stride to the next, in samples; intervals that are fitted or validated [s].
WINDOW, STRIDE, BLOCK = 12, 3, 0.5
#: Share of the variance that a curve has to explain for each of its numbers beyond the first.
PRICE = 0.001
#: Windows that a fit needs.
LEAST_WINDOWS = 40


CurveKey = tuple[str, str, str]


@dataclass(frozen=True)
class Curve:
    """An unknown input as a function of a variable: `values` (N - 1,) along `variable`.

    explained: share of the unknown input's square, validated. numbers: free ones. number: that of a nonlinear family.
    sign: (N - 1,) with which the curve changes sign.
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

    @property
    def key(self) -> CurveKey:
        """What identifies it among the curves of a log."""
        return self.unknown_input, self.family, self.against


class _Windows:
    """Means of one unknown input over windows in which it is known, and the fold of each for validation."""

    def __init__(self, values: np.ndarray, sample_time: float) -> None:
        bump = np.sin(np.pi * (np.arange(WINDOW) + 0.5) / WINDOW) ** 2
        self._weights = bump / bump.sum()
        self._usable = self._means(np.isfinite(values).astype(float)) > 1.0 - 1e-9
        self.values = self._means(filled(values))[self._usable]
        centre = STRIDE * np.arange(self._usable.size)[self._usable] * sample_time
        self._fold = (centre // BLOCK).astype(int) % 2

    def _means(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(np.lib.stride_tricks.sliding_window_view(values, WINDOW)[::STRIDE] @ self._weights)

    def of(self, columns: np.ndarray) -> np.ndarray:
        """Columns (N - 1, k) averaged over the same windows."""
        return np.column_stack([self._means(column)[self._usable] for column in columns.T])

    def fit(self, x: Regressors, unknown_input: str) -> Curve | None:
        """The best curve of these regressors; None where too few windows are left."""
        X, y = self.of(x.columns), self.values
        if x.fixed:
            left = y - X[:, 0]
            values = x.columns[:, 0]
        else:
            left = np.empty_like(y)
            for fold in (0, 1):
                train, test = self._fold != fold, self._fold == fold
                if train.sum() < 2 * X.shape[1] + 5:
                    return None
                left[test] = y[test] - X[test] @ _ridge(X[train], y[train])
            values = x.columns @ _ridge(X, y)
            # Outside the fitted windows a curve is bounded.
            low, high = np.quantile(y, [0.002, 0.998])
            values = np.clip(values, 1.3 * min(low, 0.0), 1.3 * max(high, 0.0))
        total = float(y @ y)
        explained = 1.0 - float(left @ left) / total if total > 0.0 else 0.0
        explained -= PRICE * (X.shape[1] - 1)
        return Curve(
            unknown_input, x.family, x.against, x.unit, x.variable, values, explained, X.shape[1], x.number, x.sign
        )


def _ridge(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares with a small ridge for columns that are hardly excited."""
    size = np.sqrt(np.mean(X**2, axis=0)) + 1e-300
    G = (X / size).T @ (X / size) / len(y)
    return np.asarray(np.linalg.solve(G + 1e-3 * np.eye(len(G)), (X / size).T @ y / len(y)) / size)


def curves_of(plant: Plant, signals: BalanceSignals, name: str, values: np.ndarray) -> list[Curve]:
    """All curves of an unknown input (N - 1,), best explained first, the best of each family."""
    windows = _Windows(values, signals.sample_time)
    if windows.values.size < LEAST_WINDOWS:
        return []
    if name == "torque":
        candidates = torque_regressors(plant, signals, _orders(windows, plant, signals))
    elif name == "force":
        candidates = force_regressors(plant, signals)
    else:
        candidates = flow_regressors(plant, signals, name, _orders(windows, plant, signals))
    best = _best_of_each(candidates, windows, name, {})
    for curve in [c for c in best.values() if c.family in FITTED and c.explained > 0.3]:
        finer = curve.number * np.array([0.8, 0.87, 0.94, 1.07, 1.14, 1.23])
        best = _best_of_each(drive_regressors(plant, signals, curve.family, finer), windows, name, best)
    return sorted(best.values(), key=lambda curve: -curve.explained)


def _best_of_each(
    candidates: list[Regressors], windows: _Windows, name: str, known: dict[CurveKey, Curve]
) -> dict[CurveKey, Curve]:
    best = dict(known)
    for curve in (windows.fit(x, name) for x in candidates):
        if curve is not None and (curve.key not in best or curve.explained > best[curve.key].explained):
            best[curve.key] = curve
    return best


def _orders(windows: _Windows, plant: Plant, signals: BalanceSignals, count: int = 2) -> tuple[float, ...]:
    """Periods per turn of the shaft that dominate an unknown input."""
    angle = shaft_angle(plant, signals)
    gains = []
    for order in range(1, 25):
        X = windows.of(np.column_stack([np.sin(order * angle), np.cos(order * angle)]))
        a = _ridge(X, windows.values)
        gains.append((float(np.sum((X @ a) ** 2)), float(order)))
    return tuple(order for _, order in sorted(gains, reverse=True)[:count])


@dataclass(frozen=True)
class Regime:
    """A curve that an unknown input follows.

    balance: "torque", "flow_1", "flow_2" or "force". against: the variable in words, unit its unit. bins (k,): where
    on it. mean, sd (k,): the unknown input there, SI units of the balance; times the sign of the motion for a regime
    "against the motion", times that of the variable that it goes "with". explained: share of its variance, validated on
    data that was not fitted. gap_closed: share of the squared gap that this curve alone closes, nan where that was not
    simulated. words: one line.
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

    def __str__(self) -> str:
        return f"{self.balance}: {self.words}"


def regime_of(curve: Curve, values: np.ndarray, gap_closed: float = float("nan"), bins: int = 15) -> Regime:
    """A curve with its bins: mean and standard deviation of the unknown input (N - 1,) along the variable."""
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
    explained = float(np.clip(curve.explained, 0.0, 1.0))
    return Regime(
        curve.unknown_input, curve.against, curve.unit, middle, mean, sd, explained, _words(curve), gap_closed
    )


def _words(curve: Curve) -> str:
    unit = UNITS[curve.unknown_input]
    name = {"torque": "torque error", "force": "force error"}.get(
        curve.unknown_input, f"error of the flow into chamber {curve.unknown_input[-1]}"
    )
    size = float(np.sqrt(np.mean(curve.values**2)))
    plain = {
        "constant": f"{name} of {np.mean(curve.values):.3g} {unit}, constant",
        "sign": f"{name} of {size:.3g} {unit} with {curve.against}",
        "late": f"as if the current came {1e3 * curve.number:.2g} ms late",
        "lag": f"as if the current lagged with {1e3 * curve.number:.2g} ms",
        "slope": f"as if the current changed by no more than {curve.number:.3g} A/s",
        "dead band": f"as if the drive gave nothing within {curve.number:.2g} A",
    }
    if curve.family in plain:
        return plain[curve.family]
    if curve.family in ("line", "rate", "gain"):
        slope = float(curve.values @ curve.variable) / max(float(curve.variable @ curve.variable), 1e-300)
        return f"{name} of {size:.3g} {unit} in proportion to {curve.against}, {slope:.3g} {unit} for 1 {curve.unit}"
    if curve.family == "time":
        return _in_time(curve, name, unit)
    if curve.family in ("signed position", "position"):
        where = _only_where(curve)
        if where:
            side = ", against the motion" if curve.family == "signed position" else ""
            return f"{name} of up to {float(np.max(np.abs(curve.values))):.3g} {unit}{side}, {where}"
    return f"{name} of {size:.3g} {unit} along {curve.against}"


def _in_time(curve: Curve, name: str, unit: str) -> str:
    """Constant from an instant on, or drifting."""
    y, n = curve.values, curve.values.size
    sums = np.cumsum(y)
    k = np.arange(n // 20, n - n // 20)
    before, after = sums[k] / (k + 1.0), (sums[-1] - sums[k]) / (n - 1.0 - k)
    gain = (k + 1.0) * before**2 + (n - 1.0 - k) * after**2 - n * np.mean(y) ** 2
    best = int(np.argmax(gain))
    if gain[best] > 0.8 * n * float(np.var(y)) and abs(before[best]) < 0.2 * abs(after[best]):
        return f"{name} of {after[best]:.3g} {unit} from {curve.variable[k[best]]:.1f} s on"
    return f"{name} of {float(np.sqrt(np.mean(y**2))):.3g} {unit}, drifting in time"


def _only_where(curve: Curve) -> str:
    """Where on its variable a curve is much larger than elsewhere; empty if that is nowhere or everywhere."""
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
