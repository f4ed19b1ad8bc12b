"""Refits: free-run errors over a log minimised over a hypothesis' numbers and all nominal parameters together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear

from ..core.errors import InputError
from ..physics.effects import Free
from ..plant.arrays import needed_to_simulate
from .signals import gap, largest, rod_velocity, scored, signal_noise
from .suspect import Suspect, wears
from .twin import Twin

#: Symbols that count as nominal parameters which a modeller has a little wrong, with the most that is believed of
#: their relative error.
NOMINAL = {
    "K_T": 0.05, "J_M": 0.1, "A_FM": 0.1, "B_FM": 0.1, "C_FM": 0.15, "K_L": 0.15, "V_10": 0.1, "V_20": 0.1, "V": 0.1,
    "M": 0.1, "A_FR": 0.1, "B_FR": 0.1, "C_FR": 0.15, "tau_FM": 0.15, "tau_FR": 0.15, "K_S": 0.1,
}  # fmt: skip
#: One residual counts as this share of an independent one: neighbours err together where a model is a little wrong.
TEMPER = 0.02
#: Prior deviation of a nominal parameter: what alone makes this share of the threshold; step of its derivative.
SHARE, STEP = 0.3, 0.02
#: Prior deviation of numbers of a model without dry friction, which were fitted to stand for it.
LUMPED = 0.3
#: A nominal parameter is too large by no more than this factor: an engine gets along badly with a rod without mass.
WRONG = 5.0
#: Residuals are judged in blocks of this length [s]: a slip that a simulation misses spoils a block, not a sample.
BLOCK = 0.1
#: A block counts in full up to about this mean square, in units of the usual one, and less and less beyond.
TOLERATED = 6.25
#: A model is never believed to be better than this share of a signal's spread.
MODEL_SHARE = 0.004


@dataclass(frozen=True)
class Metric:
    """What the errors of each channel are divided by, and its noise; `rod_velocity` is a channel of its own."""

    scale: Mapping[str, float]
    noise: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, twin: Twin, noise: Mapping[str, float]) -> Metric:
        log = twin.log
        signals = {channel: log[channel] for channel in twin.channels}
        if "position" in signals:
            signals["rod_velocity"] = rod_velocity(log["position"], log.sample_time)
        sd = {**noise, **signal_noise(noise, log.sample_time)}
        scale = {name: float(np.hypot(sd[name], MODEL_SHARE * float(np.std(v)))) for name, v in signals.items()}
        if "position" in scale:
            # The noise of the logged current lets the rod drift in any free run.
            scale["position"] = float(np.hypot(scale["position"], 1.5e-4))
        return cls(scale, {name: sd[name] for name in scale})

    @property
    def noise_squares(self) -> np.ndarray:
        """Mean square of each channel's residuals (channels,) that are noise and nothing else."""
        return np.array([(self.noise[name] / scale) ** 2 for name, scale in self.scale.items()])

    def residual(self, twin: Twin, simulated: Mapping[str, np.ndarray], first: int = 0) -> np.ndarray:
        """Measured minus simulated of all channels in one vector, every second sample of each from `first` on."""
        log, parts = twin.log, []
        for channel, scale in self.scale.items():
            if channel == "rod_velocity":
                error = rod_velocity(log["position"] - simulated["position"], log.sample_time)
            else:
                error = log[channel] - simulated[channel]
            parts.append(error[first::2] / scale)
        return np.concatenate(parts)


@dataclass(frozen=True)
class Nominal:
    """The nominal parameters that every hypothesis may move a little: names, believed values, prior deviations."""

    names: tuple[str, ...]
    values: np.ndarray
    sd: np.ndarray

    @classmethod
    def of(
        cls, twin: Twin, metric: Metric, threshold: float, *, lumped: bool = False
    ) -> tuple[Nominal, dict[str, np.ndarray]]:
        """Nominal parameters of a twin, and the derivative of the residual (n,) by one deviation of each.

        A parameter that alone moves a signal by the threshold is a cause, so that a modeller who is a little wrong is
        wrong by less: the prior deviation makes SHARE of the threshold, or is the relative one of NOMINAL if that is
        less.

        lumped: the model leaves so much out that its numbers stand for more than their names say; all but the torque
        constant may move by LUMPED of themselves.
        """
        plant, dt = twin.plant, twin.log.sample_time
        usual = {plant.structure.system.own(name): relative for name, relative in NOMINAL.items()}
        asked = needed_to_simulate(plant.structure.equations)
        names = [name for name in usual if name in asked and plant[name] != 0.0]
        base, *moved = twin.run([{}, *({name: plant[name] * (1.0 + STEP)} for name in names)])
        if base is None:
            raise InputError(
                f"{twin.log.path or 'the log'}: the believed plant can't be simulated with this log's current; check "
                "its parameters and the current's unit and sign"
            )
        signals, residual = scored(base, dt), metric.residual(twin, base)
        kept, sds, columns = [], [], {}
        for name, run in zip(names, moved, strict=True):
            if run is None:
                continue
            size = max(largest(gap(signals, scored(run, dt), dict.fromkeys(signals, 0.0))), 1e-9)
            relative = min(usual[name], SHARE * threshold / size * STEP)
            if lumped and name != "K_T":
                relative = LUMPED
            kept.append(name)
            sds.append(relative * plant[name])
            columns[name] = (metric.residual(twin, run) - residual) * (relative / STEP)
        return cls(tuple(kept), np.array([plant[name] for name in kept]), np.array(sds)), columns

    def loose(self, factor: float) -> Nominal:
        """The same with priors that are wider by a factor."""
        return Nominal(self.names, self.values, self.sd * factor)


@dataclass
class Refit:
    """A hypothesis at its best values.

    values: all free numbers by name. cost: tempered sum of squares with the priors. chi: RMS of the residuals.
    residual: (n,) at the end; jacobian: (n, k) its derivatives by one scale of each of `frees`, the suspects' first.
    """

    suspects: tuple[Suspect, ...]
    values: dict[str, float]
    cost: float
    chi: float
    residual: np.ndarray = field(repr=False)
    jacobian: np.ndarray = field(repr=False)
    frees: tuple[Free, ...] = ()

    @property
    def own(self) -> int:
        """How many of the free numbers are the suspects'."""
        return sum(len(s.free) for s in self.suspects)


class Bench:
    """A twin with a metric and nominal parameters: runs hypotheses and weighs what they leave.

    level: mean square of a block's residuals that is usual; blocks far above it count less (Cauchy's loss).
    """

    def __init__(self, twin: Twin, metric: Metric, nominal: Nominal) -> None:
        self.twin, self.metric, self.nominal = twin, metric, nominal
        self.level = 1.0
        self.runs = 0
        self.block = max(int(round(BLOCK / (2.0 * twin.log.sample_time))), 1)

    def residuals(self, settings: Sequence[Mapping[str, float]], jobs: int = 1) -> list[np.ndarray | None]:
        self.runs += len(settings)
        out: list[np.ndarray | None] = []
        for simulated in self.twin.run(settings, jobs):
            r = None if simulated is None else self.metric.residual(self.twin, simulated)
            out.append(r if r is not None and np.isfinite(r).all() else None)
        return out

    def blocks(self, r: np.ndarray) -> np.ndarray:
        """Mean squares (channels, blocks) of residuals (n,); a rest at the end that fills no block joins the last."""
        parts = r.reshape(len(self.metric.scale), -1)
        edges = np.arange(0, max(parts.shape[1] - self.block + 1, 1), self.block)
        length = np.diff(np.append(edges, parts.shape[1]))
        return np.asarray(np.add.reduceat(parts**2, edges, axis=1) / length)

    def slow_squares(self, r: np.ndarray) -> np.ndarray:
        """Mean squares (channels,) of the means of residuals (n,) over blocks, in which noise is small."""
        parts = r.reshape(len(self.metric.scale), -1)
        count = max(parts.shape[1] // self.block, 1)
        means = parts[:, : count * self.block].reshape(len(parts), count, -1).mean(axis=2)
        return np.asarray(np.mean(means**2, axis=1))

    def loss(self, r: np.ndarray) -> float:
        """Sum over blocks, each as many squares as it has samples, with the large ones held down."""
        c = TOLERATED * self.level
        return float(np.sum(c * np.log1p(self.blocks(r) / c))) * self.block

    def weights(self, r: np.ndarray) -> np.ndarray:
        """Root of what each residual counts (n,)."""
        parts = r.reshape(len(self.metric.scale), -1)
        w = 1.0 / np.sqrt(1.0 + self.blocks(r) / (TOLERATED * self.level))
        each = np.minimum(np.arange(parts.shape[1]) // self.block, w.shape[1] - 1)
        return np.asarray(w[:, each].ravel())

    def usual(self, r: np.ndarray) -> float:
        """The level of a residual: median of the blocks' mean squares over channels, at least one."""
        return max(float(np.median(self.blocks(r).mean(axis=0))), 1.0)


def frees_of(nominal: Nominal, suspects: Sequence[Suspect]) -> tuple[Free, ...]:
    """All free numbers: the suspects' first, without a prior, then the nominal ones in prior deviations."""
    own = [free for suspect in suspects for free in suspect.free]
    names, by_factors = {free.name for free in own}, wears()
    rest = [
        Free(name, value, sd, 0.0 if name in by_factors else value / WRONG)
        for name, value, sd in zip(nominal.names, nominal.values, nominal.sd, strict=True)
        if name not in names
    ]
    return (*own, *rest)


def refit(
    bench: Bench,
    suspects: Sequence[Suspect],
    start: Mapping[str, float],
    known: Mapping[str, np.ndarray],
    *,
    steps: int = 6,
    fresh: int = 0,
    enough: float = 0.05,
) -> Refit | None:
    """Damped Gauss-Newton from `start`; derivatives of the nominal parameters are taken from `known` and corrected.

    known: name -> (n,) derivative of the simulated residual by one scale of that number, near the start.
    fresh: after so many steps all derivatives are taken anew (0: never).
    """
    frees = frees_of(bench.nominal, suspects)
    nominal = np.array([f.nominal for f in frees])
    scale = np.array([f.scale for f in frees])
    lower, upper = np.array([f.lower for f in frees]), np.array([f.upper for f in frees])
    names = [f.name for f in frees]
    x = np.array([start.get(f.name, f.nominal) for f in frees])
    own = sum(len(s.free) for s in suspects)

    def setting(x: np.ndarray) -> dict[str, float]:
        return dict(zip(names, x.tolist(), strict=True))

    def pull(x: np.ndarray) -> np.ndarray:
        return np.asarray((x[own:] - nominal[own:]) / scale[own:])

    def cost_of(r: np.ndarray, x: np.ndarray) -> float:
        p = pull(x)
        return TEMPER * bench.loss(r) + float(p @ p)

    def column(i: int, x: np.ndarray) -> tuple[dict[str, float], float]:
        h = 0.3 * scale[i] if i < own else min(0.3 * scale[i], STEP * abs(nominal[i]))
        if x[i] + h > upper[i]:
            h = -h
        moved = x.copy()
        moved[i] += h
        return setting(moved), h

    def derivatives(which: Sequence[int], x: np.ndarray, r: np.ndarray, J: np.ndarray) -> None:
        asked = [column(i, x) for i in which]
        for i, (_, h), moved in zip(which, asked, bench.residuals([s for s, _ in asked]), strict=True):
            J[:, i] = 0.0 if moved is None else (moved - r) * (scale[i] / h)

    def normal(J: np.ndarray, r: np.ndarray, x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        weighed = J * w[:, None]
        G = TEMPER * (weighed.T @ weighed)
        g = TEMPER * (weighed.T @ (w * r))
        G[np.arange(own, len(frees)), np.arange(own, len(frees))] += 1.0
        g[own:] += pull(x)
        return G, g

    first = bench.residuals([setting(x)])[0]
    if first is None:
        return None
    r = first
    J = np.zeros((r.size, len(frees)))
    missing = [i for i, name in enumerate(names) if name not in known or i < own]
    for i, name in enumerate(names):
        if i not in missing:
            J[:, i] = known[name]
    derivatives(missing, x, r, J)
    cost, damping, drop = cost_of(r, x), 1e-3, np.inf
    renewed = not fresh
    for step in range(steps):
        if fresh and step == fresh and not renewed:
            derivatives(range(len(frees)), x, r, J)
            renewed = True
        w = bench.weights(r)
        G, g = normal(J, r, x, w)
        gained = False
        for _ in range(4):
            z = _bounded(G, g, damping, (lower - x) / scale, (upper - x) / scale)
            trial = np.clip(x + z * scale, lower, upper)
            z = (trial - x) / scale
            new = bench.residuals([setting(trial)])[0]
            if new is None:
                damping = max(10.0 * damping, 1e-2)
                continue
            miss = new - r - J @ z
            J += np.outer(miss, z / max(float(z @ z), 1e-12))
            c = cost_of(new, trial)
            if c < cost:
                gained = True
                drop = cost - c
                x, r, cost = trial, new, c
                damping = max(0.2 * damping, 1e-6)
                break
            G, g = normal(J, r, x, w)
            damping = max(10.0 * damping, 1e-2)
        if not gained and not renewed:
            # Derivatives from elsewhere may point the wrong way.
            derivatives(range(len(frees)), x, r, J)
            renewed, damping = True, 1e-2
            continue
        if not gained or drop < enough:
            break
    return Refit(
        suspects=tuple(suspects), values=setting(x), cost=cost, chi=float(np.sqrt(np.mean(r**2))), residual=r,
        jacobian=J, frees=frees,
    )  # fmt: skip


def _bounded(G: np.ndarray, g: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step within bounds that minimises the damped quadratic, by its Cholesky factor."""
    D = np.diag(np.maximum(np.diag(G), 1e-9))
    H = G + damping * D + 1e-10 * np.eye(len(G))
    L = np.linalg.cholesky(H)
    target = -np.linalg.solve(L, g)
    low, high = np.minimum(np.maximum(low, -20.0), -1e-12), np.maximum(np.minimum(high, 20.0), 1e-12)
    return np.asarray(lsq_linear(L.T, target, bounds=(low, high), method="bvls").x)
