"""Curves that an unknown input follows, found without a catalogue of effects.

The columns of a basis are fitted to the unknown input, both averaged over short bumps, on every second half of a second
and judged on the others: state dependent parameter estimation with cross-validation (P. C. Young, "Recursive Estimation
and Time-Series Analysis", Springer 2011) in its simplest form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..plant.plant import Plant
from .bases import FITTED, Basis, drive_basis, flow_bases, force_bases, torque_bases
from .unknown_input import Signals, filled

#: Length of a bump and how far one is from the next, in samples; pieces of time that are fitted or judged, in s.
BUMP, STRIDE, BLOCK = 12, 3, 0.5
#: A curve with more numbers has to explain this much more for each.
PRICE = 0.001


@dataclass(frozen=True)
class Curve:
    """A regime before it is put into words: its family, what it is against, and the input (N - 1,) that it gives."""

    balance: str
    family: str
    against: str
    unit: str
    variable: np.ndarray
    values: np.ndarray
    explained: float
    numbers: int
    number: float = float("nan")
    turned: np.ndarray | None = None


class Rows:
    """Means over bumps of one unknown input, at least two thirds of each told; which rows are fitted, which judge."""

    def __init__(self, values: np.ndarray, sample_time: float) -> None:
        bump = np.sin(np.pi * (np.arange(BUMP) + 0.5) / BUMP) ** 2
        self.bump = bump / bump.sum()
        known = np.isfinite(values)
        self.usable = self._windows(known.astype(float)) > 1.0 - 1e-9
        self.values = self._windows(filled(values))[self.usable]
        centre = STRIDE * np.arange(self.usable.size)[self.usable] * sample_time
        self.fold = (centre // BLOCK).astype(int) % 2
        self.told = known

    def _windows(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(np.lib.stride_tricks.sliding_window_view(values, BUMP)[::STRIDE] @ self.bump)

    def of(self, columns: np.ndarray) -> np.ndarray:
        return np.column_stack([self._windows(column)[self.usable] for column in columns.T])

    def fit(self, basis: Basis, balance: str) -> Curve | None:
        """The basis' best curve, with the part of the unknown input's square that it explains where it was not fitted.

        None where too few rows are left.
        """
        if self.values.size < 40:
            return None
        X, y = self.of(basis.columns), self.values
        if basis.fixed:
            left = y - X[:, 0]
            values = basis.columns[:, 0]
        else:
            left = np.empty_like(y)
            for fold in (0, 1):
                train, test = self.fold != fold, self.fold == fold
                if train.sum() < 2 * X.shape[1] + 5:
                    return None
                left[test] = y[test] - X[test] @ _ridge(X[train], y[train])
            values = basis.columns @ _ridge(X, y)
            # Where nothing was fitted a curve may not run away.
            low, high = np.quantile(y, [0.002, 0.998])
            values = np.clip(values, 1.3 * min(low, 0.0), 1.3 * max(high, 0.0))
        total = float(y @ y)
        explained = 1.0 - float(left @ left) / total if total > 0.0 else 0.0
        return Curve(balance, basis.family, basis.against, basis.unit, basis.variable, values,
                     explained - PRICE * (X.shape[1] - 1), X.shape[1], basis.number, basis.turned)  # fmt: skip


def _ridge(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares, held back a little where the columns are hardly excited."""
    size = np.sqrt(np.mean(X**2, axis=0)) + 1e-300
    G = (X / size).T @ (X / size) / len(y)
    return np.asarray(np.linalg.solve(G + 1e-3 * np.eye(len(G)), (X / size).T @ y / len(y)) / size)


def curves_of(plant: Plant, signals: Signals, balance: str, values: np.ndarray) -> list[Curve]:
    """All curves of a balance's unknown input (N - 1,), best explained first, the best of each family."""
    rows = Rows(values, signals.sample_time)
    bases: list[Basis]
    if rows.values.size < 40:
        return []
    if balance == "torque":
        bases = torque_bases(plant, signals, _orders(rows, signals))
    elif balance == "force":
        bases = force_bases(plant, signals)
    else:
        bases = flow_bases(plant, signals, balance[-1], _orders(rows, signals))
    best: dict[tuple[str, str], Curve] = {}

    def weigh(bases: list[Basis]) -> None:
        for basis in bases:
            curve = rows.fit(basis, balance)
            key = (basis.family, basis.against)
            if curve is not None and (key not in best or curve.explained > best[key].explained):
                best[key] = curve

    weigh(bases)
    for curve in [c for c in best.values() if c.family in FITTED and c.explained > 0.3]:
        weigh(drive_basis(plant, signals, curve.family, curve.number * np.array([0.8, 0.87, 0.94, 1.07, 1.14, 1.23])))
    return sorted(best.values(), key=lambda curve: -curve.explained)


def _orders(rows: Rows, signals: Signals, count: int = 2) -> tuple[float, ...]:
    """Periods a turn of the shaft that stand out in an unknown input."""
    omega = signals["omega"]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * signals.sample_time])[:-1]
    gains = []
    for order in range(1, 25):
        X = rows.of(np.column_stack([np.sin(order * angle), np.cos(order * angle)]))
        a = _ridge(X, rows.values)
        gains.append((float(np.sum((X @ a) ** 2)), float(order)))
    return tuple(order for _, order in sorted(gains, reverse=True)[:count])
