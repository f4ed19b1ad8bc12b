"""From refits to a verdict: which members of a hypothesis matter, which rivals the log can't exclude, what is left.

A member matters when it alone moves a signal by the threshold or more: that is what a cause is. What a hypothesis
holds besides is as a nominal parameter that is a little wrong, and costs it a little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from .evidence import worth
from .fit import TOLERATED, Refit
from .held_out import Stretch
from .search import Search, pulls
from .signals import gap, largest, scored

#: A member matters if it moves a signal by this share of the threshold: what is measured is not exact.
MATTERS = 0.85
#: The same for a nominal parameter that the hypothesis does not ask about.
PLAINLY = 1.3
#: What a member that does not matter costs, in units of evidence (twice the log-likelihood).
COMPANION = 20.0
#: What each number costs that a member sets free.
NUMBER = 5.0

Key = tuple[str, str | None]

#: Draws of the logged current's noise that show what it does to runs.
DRAWS = 6
#: Nominal parameters this far from what is believed, in prior deviations, are looked at one by one.
FAR = 1.5


@dataclass(frozen=True)
class Slow:
    """What a hypothesis leaves of the residuals' means over blocks, in which noise is small.

    Position is left out, which adds up whatever noise and missed slips do, and the load cell, which no gap counts.
    share: RMS over the other channels, of that of the nominal model. size: RMS of the worst channel, in the metric's
    units.
    """

    share: float = 0.0
    size: float = 0.0


@dataclass(frozen=True)
class Shaken:
    """What the noise of the logged current alone does to a run: the rig was not driven by it, every simulation is.

    Where the rod sticks and slips it decides single slips, so that the true plant leaves a gap too. The most of some
    draws: what noise can do, not what it mostly does, is no proof that a model is wrong. slow: (channels,) mean squares
    of block means. square: mean square of residuals. gap: in total.
    """

    slow: np.ndarray
    square: float
    gap: float


@dataclass(frozen=True)
class Judged:
    """A hypothesis with what it leaves.

    evidence: smaller is better. own: (id, channel) -> gap in each signal that it makes beside the others, of the
    members and of nominal parameters that went far. fitted, held: gaps where it was fitted and on what was held out.
    slow: what is left in either of the two.
    """

    fit: Refit
    evidence: float
    own: Mapping[Key, Mapping[str, float]]
    fitted: Mapping[str, float]
    held: Mapping[str, float]
    causes: tuple[Key, ...]
    slow: tuple[Slow, Slow] = (Slow(), Slow())

    @property
    def label(self) -> tuple[Key, ...]:
        """The causes in no order."""
        return tuple(sorted(self.causes, key=str))


class Judge:
    """Weighs the hypotheses of a search against each other, on what was fitted and on what was held out.

    lumped: nominal parameters stand for more than their names say, and are no causes.
    """

    def __init__(
        self, search: Search, fitted: Stretch, held: Stretch, threshold: float, *, lumped: bool = False
    ) -> None:
        self.search, self.fitted, self.held, self.threshold, self.lumped = search, fitted, held, threshold, lumped
        bench = search.bench
        best = search.best()[0]
        channels = len(bench.metric.scale)
        weighed = (best.residual * bench.weights(best.residual)).reshape(channels, -1)
        self.worth = worth(weighed, 2.0 * bench.twin.log.sample_time)
        self.known: dict[int, Judged] = {}
        run = held.simulate({})
        missed = None if run is None else held.residual(bench.metric, run)
        #: Residuals of the nominal model where hypotheses are fitted, and on what is held out.
        self.nominal = search.residual, missed
        self.shaken = self._shaken(fitted, best.values), self._shaken(held, best.values)

    def weigh(self, r: np.ndarray) -> float:
        """Evidence of residuals (n,): blocks held down as in the fits, channels by what they are worth."""
        bench = self.search.bench
        c = TOLERATED * bench.level
        return float(np.sum(self.worth[:, None] * c * np.log1p(bench.blocks(r) / c))) * bench.block

    def judge(self, fit: Refit) -> Judged:
        """A hypothesis simulated on both stretches, and once without each of its members."""
        if id(fit) in self.known:
            return self.known[id(fit)]
        bench = self.search.bench
        simulated = self.held.simulate(fit.values)
        missed = None if simulated is None else self.held.residual(bench.metric, simulated)
        evidence = self.weigh(fit.residual) + (np.inf if missed is None else self.weigh(missed)) + pulls(fit)
        own = self.alone(fit)
        members = {s.key for s in fit.suspects}
        # Nominal parameters trade for each other within their priors: one that is not asked about must matter plainly.
        limits = {key: (MATTERS if key in members else PLAINLY) * self.threshold for key in own}
        causes = tuple(key for key, gaps in own.items() if largest(gaps) >= limits[key])
        evidence += COMPANION * len(members - set(causes)) + NUMBER * fit.own
        slow = self._slow(0, fit.residual), self._slow(1, missed)
        found = Judged(fit, evidence, own, self.fitted.gap(fit.values), self.held.gap_of(simulated), causes, slow)
        self.known[id(fit)] = found
        return found

    @property
    def most(self) -> float:
        """Evidence that the nominal model leaves; where it stops, as much again as where it was fitted."""
        fitted, held = self.nominal
        return self.weigh(fitted) + self.weigh(fitted if held is None else held)

    def _slow(self, stretch: int, r: np.ndarray | None) -> Slow:
        nominal = self.nominal[stretch]
        if r is None or nominal is None:
            return Slow(1.0, np.inf) if r is None else Slow()
        bench, shaken = self.search.bench, self.shaken[stretch].slow
        noise = bench.metric.noise_squares / bench.block
        counted = [i for i, name in enumerate(bench.metric.scale) if name not in ("position", "force")]
        left = np.maximum(bench.slow_squares(r) - noise - shaken, 0.0)[counted]
        before = np.maximum(bench.slow_squares(nominal) - noise, 0.0)[counted]
        share = float(np.sqrt(np.sum(left) / max(np.sum(before), 1e-12)))
        return Slow(share, float(np.sqrt(np.max(left))))

    def _shaken(self, stretch: Stretch, values: Mapping[str, float]) -> Shaken:
        metric, twin = self.search.bench.metric, stretch.twin
        still = Shaken(np.zeros(len(metric.scale)), 0.0, 0.0)
        drive = twin.plant.structure.system.drive
        sensor = twin.plant.sensors.get(drive)
        # A controller's answer to noise looks like noise of the current, and is none.
        sd = min(stretch.noise.get(drive, 0.0), sensor.sd if sensor is not None else np.inf)
        run = stretch.simulate(values)
        if sd == 0.0 or run is None:
            return still
        slow, square, gaps = [], [], []
        for draw in range(DRAWS):
            noise = sd * np.random.default_rng(draw).standard_normal(len(twin.log))
            driven = {**twin.log.channels, drive: twin.log[drive] + noise}
            other = replace(stretch, twin=replace(twin, log=replace(twin.log, channels=driven))).simulate(values)
            if other is None:
                return still
            r = stretch.residual(metric, other) - stretch.residual(metric, run)
            slow.append(self.search.bench.slow_squares(r))
            square.append(float(np.mean(r**2)))
            dt = twin.log.sample_time
            a, b = ({n: v[stretch.first :] for n, v in scored(shown, dt).items()} for shown in (run, other))
            gaps.append(gap(a, b, dict.fromkeys(a, 0.0))["total"])
        return Shaken(np.max(slow, axis=0), max(square), max(gaps))

    @property
    def floor(self) -> float:
        """Evidence that noise alone would leave on both stretches."""
        metric, held = self.search.bench.metric, self.held
        samples = self.search.residual.size // len(metric.scale) + (len(held.twin.log) - held.first) // 2
        return float(self.worth @ metric.noise_squares) * samples

    def alone(self, fit: Refit) -> dict[Key, dict[str, float]]:
        """By how much each member moves each signal: the model with all of them against the one without it."""
        groups: dict[Key, set[str]] = {s.key: set(s.names) for s in fit.suspects}
        ids = ids_of(self.search.bench.twin.plant)
        for f in fit.frees[fit.own :]:
            if not self.lumped and abs(fit.values[f.name] - f.nominal) > FAR * f.scale:
                groups.setdefault((ids[f.name], None), set()).add(f.name)
        settings = [{n: v for n, v in fit.values.items() if n not in names} for names in groups.values()]
        out: dict[Key, dict[str, float]] = {key: {} for key in groups}
        # A valve or an end may be reached in one of the two stretches alone.
        for twin, first in ((self.search.bench.twin, 0), (self.held.twin, self.held.first)):
            full, *without = twin.run([fit.values, *settings])
            for key, other in zip(groups, without, strict=True):
                moved = {"rod_velocity": np.inf, "total": np.inf}
                if full is not None and other is not None:
                    dt = twin.log.sample_time
                    a, b = ({n: v[first:] for n, v in scored(run, dt).items()} for run in (full, other))
                    moved = gap(a, b, dict.fromkeys(a, 0.0))
                out[key] = {name: max(out[key].get(name, 0.0), value) for name, value in moved.items()}
        return out


def ids_of(plant: Plant) -> dict[str, str]:
    """Under which id a nominal parameter of this plant that is wrong is reported."""
    own = plant.structure.system.own
    return {own(symbol): name for name, effect in EFFECTS.items() for symbol in (*effect.symbols, *effect.also)}


def by_label(judged: Sequence[Judged]) -> dict[tuple[Key, ...], Judged]:
    """The best hypothesis of each set of causes."""
    best: dict[tuple[Key, ...], Judged] = {}
    for one in judged:
        if one.label not in best or one.evidence < best[one.label].evidence:
            best[one.label] = one
    return best
