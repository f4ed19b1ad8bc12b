"""Which rigs changed, in what, and since when: score tests on the logs of each rig.

The logs of a rig share the plant's parameters. For each cause of the catalogue, the alternative is that its parameters
differ from one log on (a step), or move in proportion to time (a drift). What is the same in all logs of the rig is
estimated beside, of the plant and of all effects: a rig which merely differs from the plant's file has not changed.
Under the quadratic approximation of `score` everything follows in closed form.

What counts as a change, `null` decides by the fleet's own distribution of the largest statistic, and the procedure of
Benjamini and Hochberg over the rigs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .null import LargestNull, largest_null
from .score import LogScore

# The constants without another reason are engineering judgement.

#: Prior standard deviation of what an effect does in all logs of a rig, in the smallest sizes that a log shows.
ALWAYS = 5.0
#: A direction whose information is below this share of the largest is not tested.
LEAST_SHARE = 1e-6
#: What one more parameter of a cause must explain: Akaike's information criterion counts 2, and a cause of unknown
#: place could otherwise imitate another one.
PER_PARAMETER = 4.0
#: A cause explains a change as well as the best one within this difference of the statistic, or this share of it: the
#: effect is not linear in its size, as the score test assumes.
AS_WELL, AS_WELL_SHARE = 9.0, 0.05
#: Steps that are scanned at once, so that a rig of thousands of logs needs little memory.
BLOCK = 100
#: Logs of a rig whose information is kept in memory: with the 92 names of an EHSA 0.7 GB, its sums included.
MOST_IN_MEMORY = 5000


@dataclass(frozen=True)
class StoredInformation:
    """The information of logs, (n, k, k) as an array, which is read each time that an array is made of it."""

    of_log: Callable[[int], np.ndarray]
    logs: range

    def __getitem__(self, rows: slice) -> StoredInformation:
        return StoredInformation(self.of_log, self.logs[rows])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array([self.of_log(i) for i in self.logs], dtype=dtype)


@dataclass(frozen=True)
class RigScores:
    """The scores of a rig's logs in order of time, for the same names.

    score (n, k), information (n, k, k): divided by each log's dispersion; zero for a name that a log lacks.
    days (n,): time of each log in days.
    """

    name: str
    days: np.ndarray
    score: np.ndarray
    information: np.ndarray | StoredInformation

    def blocks(self) -> Iterator[tuple[slice, np.ndarray]]:
        """The information of some logs at a time, and which."""
        for first in range(0, len(self.score), BLOCK):
            rows = slice(first, first + BLOCK)
            yield rows, np.asarray(self.information[rows])

    @cached_property
    def total(self) -> np.ndarray:
        """Sum of the information of all logs, (k, k)."""
        k = self.score.shape[1]
        return sum((block.sum(axis=0) for _, block in self.blocks()), np.zeros((k, k)))

    def part(self, first: int, last: int) -> RigScores:
        """The logs from number `first` to before `last`."""
        rows = slice(first, last)
        return RigScores(self.name, self.days[rows], self.score[rows], self.information[rows])


@dataclass(frozen=True)
class Names:
    """The names of all logs of a fleet: parameters of the plant first. scale (k,): SI value of one unit.

    causes: effect id, for a sensor with its channel -> positions of its names.
    """

    names: tuple[str, ...]
    nominal: int
    scale: np.ndarray
    causes: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, scores: Iterable[LogScore]) -> Names:
        """The union over logs, each with the smallest unit that a log gives it."""
        scale: dict[str, float] = {}
        nominal: dict[str, None] = {}
        causes: dict[str, dict[str, None]] = {}
        for one in scores:
            nominal |= dict.fromkeys(one.names[: one.nominal])
            for name, unit in zip(one.names, one.scale.tolist(), strict=True):
                scale[name] = min(unit, scale.get(name, unit))
            for cause, listed in one.causes.items():
                causes.setdefault(cause, {}).update(dict.fromkeys(listed))
        names = (*nominal, *(name for name in scale if name not in nominal))
        at = {name: i for i, name in enumerate(names)}
        positions = {cause: np.array([at[name] for name in listed]) for cause, listed in sorted(causes.items())}
        return cls(names, len(nominal), np.array([scale[name] for name in names]), positions)

    def of_parameters(self) -> Names:
        """The same names with each parameter of the plant as a cause of its own."""
        causes = {name: np.array([i]) for i, name in enumerate(self.names[: self.nominal])}
        return Names(self.names, self.nominal, self.scale, causes)

    def rig(self, name: str, days: Sequence[float], scores: Sequence[LogScore]) -> RigScores:
        """The scores of a rig's logs, in units of these names. days: of each log, ascending."""
        n, k = len(days), len(self.names)
        at = {one: i for i, one in enumerate(self.names)}
        few = n <= MOST_IN_MEMORY
        g, H = np.zeros((n, k)), np.zeros((n if few else 0, k, k))

        def in_units(one: LogScore) -> tuple[np.ndarray, np.ndarray]:
            """Score (k,) and information (k, k) of a log."""
            place = np.array([at[name] for name in one.names])
            factor = self.scale[place] / one.scale
            score, information = np.zeros(k), np.zeros((k, k))
            score[place] = one.score * factor / one.dispersion
            information[np.ix_(place, place)] = one.information * np.outer(factor, factor) / one.dispersion
            return score, information

        for i, one in enumerate(scores):
            g[i], information = in_units(one)
            if few:
                H[i] = information
        return RigScores(
            name, np.asarray(days, dtype=float), g,
            H if few else StoredInformation(lambda i: in_units(scores[i])[1], range(n)),
        )  # fmt: skip


@dataclass(frozen=True)
class Scan:
    """Statistics of one rig.

    times: number of the first log after a step, -1 for a drift. statistic (causes, times): -2 log-likelihood ratio.
    parameters (causes,): number of each that the logs show. size, variance: cause -> (times, parameters) in units of
    the names.
    """

    rig: str
    times: tuple[int, ...]
    statistic: np.ndarray
    parameters: np.ndarray
    size: Mapping[str, np.ndarray]
    variance: Mapping[str, np.ndarray]

    @property
    def statistics(self) -> Scan:
        """Without sizes and variances, which take most of the memory."""
        return replace(self, statistic=self.statistic.astype(np.float32), size={}, variance={})


def scan(rig: RigScores, names: Names, *, drift: bool = True) -> Scan:
    """Statistics of a step before each log but the first, and of a drift, for each cause; no times for a single log.

    drift: leave the drift out with False.
    """
    n = len(rig.days)
    times = [*range(1, n)] if n > 1 else []
    span = float(rig.days[-1] - rig.days[0]) if n else 0.0
    if drift and n > 2 and span > 0.0:
        times.append(-1)
    total, g = rig.total, rig.score.sum(axis=0)
    causes = names.causes
    statistic, parameters = np.zeros((len(causes), len(times))), np.zeros(len(causes))
    size = {cause: np.zeros((len(times), len(own))) for cause, own in causes.items()}
    variance = {cause: np.zeros((len(times), len(own))) for cause, own in causes.items()}
    prior = np.where(np.arange(g.size) < names.nominal, 1.0, ALWAYS**-2)
    for part, once, twice, moved in _profiles(rig, len(times)):
        gain = np.linalg.solve(total + np.diag(prior), once.transpose(0, 2, 1))
        left = twice - once @ gain
        score = moved - np.einsum("tij,i->tj", gain, g)
        for row, (cause, own) in enumerate(causes.items()):
            step, spread, rank = _solve(left[:, own[:, None], own], score[:, own], twice[:, own, own])
            statistic[row, part] = np.maximum(np.einsum("ti,ti->t", step, score[:, own]), 0.0)
            parameters[row] = max(parameters[row], np.max(rank, initial=0))
            size[cause][part], variance[cause][part] = step, spread
    return Scan(rig.name, tuple(times), statistic, parameters, size, variance)


def _profiles(rig: RigScores, times: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
    """Sums over logs with the weights of a step, 0 before it and 1 after, or of a drift, some steps at a time.

    times: number of times of the scan: a step before each log but the first, and the drift if there is one more.

    Yields which times; the information with the weights (t, k, k), with their squares, and the score (t, k).
    """
    n, k = rig.score.shape
    information, score = np.zeros((k, k)), np.zeros(k)
    # From the last step back, so that what comes after a block is one sum.
    for last in range(n, 1, -BLOCK):
        first = max(last - BLOCK, 1)
        once = np.cumsum(np.asarray(rig.information[first:last])[::-1], axis=0)[::-1] + information
        moved = np.cumsum(rig.score[first:last][::-1], axis=0)[::-1] + score
        information, score = once[0], moved[0]
        if last < n or times < n:
            yield slice(first - 1, last - 1), once, once, moved
            continue
        w = (rig.days - np.mean(rig.days)) / float(rig.days[-1] - rig.days[0])
        drift, squared = np.zeros((1, k, k)), np.zeros((1, k, k))
        for rows, block in rig.blocks():
            drift += np.tensordot(w[rows], block, 1)
            squared += np.tensordot(w[rows] ** 2, block, 1)
        yield (
            slice(first - 1, n), np.concatenate([once, drift]), np.concatenate([once, squared]),
            np.concatenate([moved, (w @ rig.score)[None]]),
        )  # fmt: skip


def _solve(matrix: np.ndarray, right: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solution (t, m), variance (t, m) and rank (t,) over the directions that have information.

    before: (t, m) information of each parameter if all others were known.
    """
    size = np.sqrt(np.maximum(before, 1e-300))
    values, vectors = np.linalg.eigh(matrix / (size[:, :, None] * size[:, None, :]))
    shown = values > np.maximum(LEAST_SHARE * values[:, -1:], LEAST_SHARE)
    inverse = np.where(shown, 1.0 / np.where(shown, values, 1.0), 0.0)
    along = np.einsum("tij,ti->tj", vectors, right / size)
    return (
        np.einsum("tij,tj->ti", vectors, along * inverse) / size,
        np.einsum("tij,tj->ti", vectors**2, inverse) / size**2,
        shown.sum(axis=1),
    )


@dataclass(frozen=True)
class RigChange:
    """The most probable change of a rig, whether significant or not.

    cause: name; same: causes that explain it as well. first: number of the first log after it; -1: a drift. earliest,
    latest: of a step, the first logs that explain the change almost as well. p: probability of a change as large by
    chance, for all times and causes. size, sd (m,): change of the cause's parameters in units of the names; of a drift,
    over all of the rig's logs. positions (m,) of these names.
    """

    rig: str
    cause: str
    same: tuple[str, ...]
    first: int
    earliest: int
    latest: int
    statistic: float
    p: float
    size: np.ndarray
    sd: np.ndarray
    positions: np.ndarray


@dataclass(frozen=True)
class ChangeTest:
    """The test of a fleet's rigs for changes.

    null: distribution of a rig's largest statistic without a change, by the fleet itself.
    """

    names: Names
    null: LargestNull

    @classmethod
    def of(cls, scans: Sequence[Scan], names: Names) -> ChangeTest | None:
        """The test that a fleet gives; None if no rig has two logs that show a cause."""
        usable = [one for one in scans if one.times]
        parameters = np.max([one.parameters for one in usable], axis=0, initial=0.0) if usable else np.zeros(0)
        return cls(names, largest_null([one.statistic for one in usable], parameters)) if parameters.any() else None

    def p(self, one: Scan) -> float:
        """Probability of a change as large by chance, for all times and causes; 1 for a rig with a single log."""
        return self.null.p(one.statistic) if one.times else 1.0

    def change(self, one: Scan) -> RigChange | None:
        """The most probable change of a rig; None for a rig with a single log."""
        if not one.times:
            return None
        listed, factor = list(self.names.causes), self.null.factor
        value = one.statistic / float(np.median(factor)) - PER_PARAMETER * one.parameters[:, None]
        value[one.parameters == 0] = -np.inf
        best, when = np.unravel_index(int(np.argmax(value)), value.shape)
        top = float(value[best, when])
        near = top - max(AS_WELL, AS_WELL_SHARE * top)
        order = np.argsort(-value.max(axis=1))
        same = [listed[i] for i in order if i != best and value[i].max() >= near]
        steps = [t for t, v in zip(one.times, value[best], strict=True) if t > 0 and v >= top - AS_WELL]
        cause, first = listed[best], one.times[when]
        return RigChange(
            one.rig, cause, tuple(same), first, min(steps, default=first), max(steps, default=first),
            float(one.statistic[best, when] / factor[best]), self.p(one), one.size[cause][when],
            np.sqrt(one.variance[cause][when] * factor[best]), self.names.causes[cause],
        )  # fmt: skip

    def steps(self, rig: RigScores, limit: float) -> list[RigChange]:
        """All steps of a rig, in order of time: the logs before and after each are searched in turn.

        Each step is then located anew between its neighbours, as one that was found while another was unknown may be
        late or early: J. Bai, "Estimating multiple breaks one at a time", Econometric Theory 13 (1997).

        limit: largest p of a step that counts.
        """
        found = sorted(self._search(rig, 0, len(rig.days), limit))
        ends = [0, *found, len(rig.days)]
        located = [self._step(rig, before, after, limit) for before, after in zip(ends[:-2], ends[2:], strict=True)]
        return list({one.first: one for one in located if one is not None}.values())

    def _search(self, rig: RigScores, first: int, last: int, limit: float) -> list[int]:
        """Numbers of the logs from `first` to before `last` at which a step begins."""
        one = self._step(rig, first, last, limit)
        if one is None:
            return []
        return [one.first, *self._search(rig, first, one.first, limit), *self._search(rig, one.first, last, limit)]

    def _step(self, rig: RigScores, first: int, last: int, limit: float) -> RigChange | None:
        """The step among the logs from `first` to before `last`; None if none has a p of at most `limit`."""
        one = self.change(scan(rig.part(first, last), self.names, drift=False))
        if one is None or one.p > limit:
            return None
        return replace(one, first=one.first + first, earliest=one.earliest + first, latest=one.latest + first)
