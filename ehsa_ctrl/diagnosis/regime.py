"""Regimes: a curve that an unknown input follows, in bins and in words."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .curves import Curve
from .unknown_input import UNITS


@dataclass(frozen=True)
class Regime:
    """A curve that an unknown input follows.

    balance: "torque", "flow_1", "flow_2" or "force". against: the variable in words, unit its unit. bins (k,): where
    on it. mean, sd (k,): the unknown input there, SI units of the balance; times the sign of the motion for a regime
    "against the motion", times that of what it is said to go with. explained: part of its variance, judged on data that
    was not fitted. gap_closed: part of the squared gap that vanishes when this curve alone is put in, nan
    where that was not tried. words: one line for people.
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
    if curve.turned is not None:
        values = values * curve.turned
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
    return Regime(curve.balance, curve.against, curve.unit, middle, mean, sd, float(np.clip(curve.explained, 0.0, 1.0)),
                  _words(curve), gap_closed)  # fmt: skip


def _words(curve: Curve) -> str:
    unit = UNITS[curve.balance]
    name = {"torque": "torque error", "force": "force error"}.get(
        curve.balance, f"error of the flow into chamber {curve.balance[-1]}"
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
