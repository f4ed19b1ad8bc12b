"""Regimes: along which variable an unknown input follows a curve, found without a catalogue of effects.

Each variable gives columns: a constant, a step in sign, straight pieces between quantiles. They are fitted to the
unknown input, both averaged over short bumps, on every second half of a second and judged on the others: state
dependent parameter estimation with cross-validation (P. C. Young, "Recursive Estimation and Time-Series Analysis",
Springer 2011) in its simplest form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from ..plant.plant import Plant
from .unknown_input import UNITS, Signals, filled

#: Length of a bump and how far one is from the next, in samples; pieces of time that are fitted or judged, in s.
BUMP, STRIDE, BLOCK = 12, 3, 0.5
#: A curve with more numbers has to explain this much more for each.
PRICE = 0.001


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


@dataclass(frozen=True)
class Basis:
    """Columns (N - 1, k) along a variable (N - 1,). fixed: added as it is, not scaled. turned: the sign (N - 1,) with
    which all of them turn over, so that their mean along the variable alone would say nothing."""

    family: str
    against: str
    unit: str
    variable: np.ndarray
    columns: np.ndarray
    fixed: bool = False
    number: float = float("nan")
    turned: np.ndarray | None = None


def hats(z: np.ndarray, count: int) -> np.ndarray:
    """(N, k) straight pieces between quantiles of z; they sum to one."""
    knots = np.unique(np.quantile(z, np.linspace(0.005, 0.995, count)))
    if knots.size < 2:
        return np.ones((z.size, 1))
    return np.column_stack([np.interp(z, knots, row) for row in np.eye(knots.size)])


def odd_hats(z: np.ndarray, sign: np.ndarray, count: int) -> np.ndarray:
    """(N, k) straight pieces along |z| that turn over with a sign: nothing that pushes one way whatever the motion."""
    return np.asarray(sign[:, None] * hats(np.abs(z), count))


def split_hats(z: np.ndarray, sign: np.ndarray, count: int) -> np.ndarray:
    """(N, k) straight pieces on either side of a sign (-1 to 1), with a jump between."""
    shares = np.clip(0.5 * (1.0 - sign), 0.0, 1.0), np.clip(0.5 * (1.0 + sign), 0.0, 1.0)
    parts = [share[:, None] * hats(np.where(share > 0.5, z, 0.0), count) for share in shares]
    return np.column_stack([part[:, np.any(part != 0.0, axis=0)] for part in parts])


def _sure_sign(s: Signals, contact: str, direction: str) -> np.ndarray:
    """(N - 1,) direction where something plainly slides, straight lines between: noise has no direction."""
    return filled(np.where(s.slides[contact], s[direction], np.nan))[:-1]


def late(current: np.ndarray, samples: float) -> np.ndarray:
    """A held current that acts `samples` later, its mean over each sample."""
    whole = int(samples)
    part = samples - whole
    before = np.concatenate([np.full(whole + 1, current[0]), current])
    return (1.0 - part) * before[1 : current.size + 1] + part * before[: current.size]


def lagging(current: np.ndarray, samples: float) -> np.ndarray:
    """A held current through a first-order lag of so many samples, its mean over each sample."""
    a = np.exp(-1.0 / samples)
    now = lfilter([0.0, 1.0 - a], [1.0, -a], current - current[0]) + current[0]
    return np.asarray(current + (now - current) * samples * (1.0 - a))


def limited(current: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(N, k) a current that changes by no more than each of `steps` (k,) a sample, its mean over each sample."""
    out, now = np.empty((current.size, steps.size)), np.full(steps.size, current[0])
    for k, value in enumerate(current.tolist()):
        way = value - now
        moved = np.minimum(np.maximum(way, -steps), steps)
        # It ramps until it is there and stays there for the rest of the sample.
        out[k] = now + moved * (1.0 - 0.5 * np.minimum(np.abs(way) / steps, 1.0))
        now = now + moved
    return out


#: What friction that grows with the load is against.
LOSS = "the size of the pressure difference, against the motion"
#: Families of a torque error that are the drive's: what pushes one way whatever the motion, or is late.
DRIVE = ("constant", "time", "late", "lag", "slope", "dead band", "current")
#: Those that follow the current as a torque constant or friction nearly does too: they have to explain clearly more.
MEMORYLESS = ("dead band", "current")
#: Those with a number that columns are not linear in.
FITTED = ("late", "lag", "slope", "dead band")


def torque_bases(plant: Plant, s: Signals, orders: tuple[float, ...]) -> list[Basis]:
    """Along what an unknown torque may go."""
    held, dt = s["current"][:-1], s.sample_time
    omega, rate, time = (s[n][:-1] for n in ("omega", "omega_rate", "time"))
    sign = _sure_sign(s, "shaft", "d_M")
    one, size = np.ones((held.size, 1)), np.abs(held)
    found = [
        Basis("constant", "time", "s", time, one),
        Basis("time", "time", "s", time, hats(time, 14)),
        Basis("sign", "the sign of the shaft's speed", "", sign, sign[:, None]),
        Basis("speed", "the shaft's speed", "rad/s", omega, odd_hats(omega, sign, 7)),
        Basis("line", "the shaft's speed", "rad/s", omega, omega[:, None]),
        Basis("rate", "the shaft's acceleration", "rad/s2", rate, rate[:, None]),
        Basis("gain", "the current", "A", held, held[:, None]),
        Basis("saturation", "the current", "A", held, np.column_stack([held, held * size, held**3])),
        Basis("signed time", "time, against the motion", "s", time, sign[:, None] * hats(time, 8), turned=sign),
        Basis("gain in time", "time, with the current", "s", time, held[:, None] * hats(time, 8), turned=np.sign(held)),
        Basis("brake", "the size of the current, against the motion", "A", size, odd_hats(held, sign, 10), turned=sign),
        Basis("current", "the current", "A", held, hats(held, 80)),
    ]
    if "P_1" in s and "P_2" in s:
        dP = (s["P_1"] - s["P_2"])[:-1]
        found += [
            Basis("line", "the pressure difference", "Pa", dP, dP[:, None]),
            Basis("pressure", "the pressure difference", "Pa", dP, odd_hats(dP, np.sign(dP), 7)),
            Basis(
                "loss",
                "the pressure difference, against the motion",
                "Pa",
                np.abs(dP),
                (sign * np.abs(dP))[:, None],
                turned=sign,
            ),
        ]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (s["omega"][1:] + s["omega"][:-1])) * dt])[:-1]
    found += [_ripple(angle, order) for order in orders]
    found += drive_basis(plant, s, "late", dt * np.array([0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 15]))
    found += drive_basis(plant, s, "lag", dt * np.array([0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 15]))
    top = float(np.max(size)) if np.any(held) else 1.0
    found += drive_basis(plant, s, "slope", top / dt * np.array([0.005, 0.01, 0.02, 0.03, 0.045, 0.07, 0.1, 0.15, 0.3]))
    return found + drive_basis(plant, s, "dead band", top * np.array([0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2]))


def drive_basis(plant: Plant, s: Signals, family: str, numbers: np.ndarray) -> list[Basis]:
    """A drive that is late [s], lags [s], has a steepest slope [A/s] or a dead band [A], for each number."""
    held, dt = s["current"][:-1], s.sample_time
    if family == "slope":
        given = list(limited(held, numbers * dt).T)
    else:
        of: dict[str, Callable[[float], np.ndarray]] = {
            "late": lambda number: late(held, number / dt),
            "lag": lambda number: lagging(held, number / dt),
            "dead band": lambda number: np.asarray(held - np.clip(held, -number, number)),
        }
        given = [of[family](float(number)) for number in numbers]
    words = "changes of the current" if family != "dead band" else "the current"
    return [
        Basis(family, words, "A", held, (plant["K_T"] * (other - held))[:, None], True, float(number))
        for other, number in zip(given, numbers, strict=True)
    ]


def force_bases(plant: Plant, s: Signals) -> list[Basis]:
    """Along what an unknown force may go."""
    x, v, time = (s[n][:-1] for n in ("x", "v", "time"))
    sign = _sure_sign(s, "rod", "d_R")
    rate = s["v_rate"][:-1]
    found = [
        Basis("constant", "time", "s", time, np.ones((x.size, 1))),
        Basis("sign", "the sign of the rod's speed", "", sign, sign[:, None]),
        Basis("sides", "the sign of the rod's speed, not alike", "", sign, split_hats(np.zeros_like(sign), sign, 2)),
        Basis("speed", "the rod's speed", "m/s", v, split_hats(v, sign, 6)),
        Basis("line", "the rod's speed", "m/s", v, v[:, None]),
        Basis("rate", "the rod's acceleration", "m/s2", rate, rate[:, None]),
        Basis("position", "the rod's position", "m", x, hats(x, 12)),
        Basis("line", "the rod's position", "m", x, x[:, None]),
        Basis(
            "signed position",
            "the rod's position, against the motion",
            "m",
            x,
            sign[:, None] * hats(x, 20),
            turned=sign,
        ),
        Basis("time", "time", "s", time, hats(time, 20)),
        Basis("signed time", "time, against the motion", "s", time, sign[:, None] * hats(time, 14), turned=sign),
    ]
    if "P_1" in s and "P_2" in s:
        dP = (s["P_1"] - s["P_2"])[:-1]
        loaded = sign[:, None] * hats(np.abs(dP), 6)
        found.append(Basis("loss", LOSS, "Pa", np.abs(dP), loaded, turned=sign))
        found.append(Basis("pressure", "the pressure difference", "Pa", dP, hats(dP, 10)))
    return found


def flow_bases(plant: Plant, s: Signals, chamber: str, orders: tuple[float, ...]) -> list[Basis]:
    """Along what an unknown flow into a chamber may go."""
    P, rate = s[f"P_{chamber}"][:-1], s[f"P_{chamber}_rate"][:-1]
    dP, omega, x, v, time = (s["P_1"] - s["P_2"])[:-1], *(s[n][:-1] for n in ("omega", "x", "v", "time"))
    here, speed = f"the pressure in chamber {chamber}", "the shaft's speed"
    pumped = omega * np.abs(dP)
    found = [
        Basis("constant", "time", "s", time, np.ones((P.size, 1))),
        Basis("line", "the pressure difference", "Pa", dP, dP[:, None]),
        Basis("pressure", "the pressure difference", "Pa", dP, hats(dP, 14)),
        Basis("level", here, "Pa", P, hats(P, 14)),
        Basis("speed", speed, "rad/s", omega, hats(omega, 13)),
        Basis("line", speed, "rad/s", omega, omega[:, None]),
        Basis("rate", f"the rate of {here}", "Pa/s", rate, rate[:, None]),
        Basis("softness", f"{here}, times its rate", "Pa", P, rate[:, None] * hats(P, 6)),
        Basis("volume", f"the rod's position, times the rate of {here}", "m", x, rate[:, None] * hats(x, 5)),
        Basis("line", "the rod's speed", "m/s", v, v[:, None]),
        Basis("time", "time", "s", time, hats(time, 14)),
        Basis(
            "pressure in time",
            "time, with the pressure difference",
            "s",
            time,
            dP[:, None] * hats(time, 8),
            turned=np.sign(dP),
        ),
        Basis("pumped", f"{speed} times the size of the pressure difference", "rad/s Pa", pumped, pumped[:, None]),
    ]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (s["omega"][1:] + s["omega"][:-1])) * s.sample_time])[:-1]
    for order in orders:
        wave = _ripple(angle, order)
        columns = np.column_stack([wave.columns, omega[:, None] * wave.columns])
        found.append(Basis("ripple", wave.against, "rad", wave.variable, columns, False, order))
    return found


def _ripple(angle: np.ndarray, order: float) -> Basis:
    columns = np.column_stack([np.sin(order * angle), np.cos(order * angle)])
    turn = np.mod(angle, 2.0 * np.pi / order)
    return Basis("ripple", f"the shaft's angle, {order:g} a turn", "rad", turn, columns, False, order)


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
