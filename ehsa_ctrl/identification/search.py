"""The search behind `experiment`: which of many inputs keeps the limits and tells most."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import combinations
from typing import TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from ..core.errors import InputError, SimulationError
from ..core.unit import factor
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.limits import SHOWN
from ..simulation.trajectory import Trajectory
from .admissible import LimitUse, run_shares, variations, worst_of
from .forecast import Forecast, forecast_run
from .free import FreeParameter
from .rehearsal import Rehearsal, rehearse
from .shapes import Shape, joined, single_shapes
from .uncertainty import POOR, invert

CRITERIA = ("worst", "D")
#: Inputs are compared over at most this time first [s]: what tells more in 8 s mostly does so in 60 s.
SCREENING = 8.0
#: Shares of the largest amplitude that are tried first: friction shows better where the plant hardly moves. Then, with
#: so many more runs, what lies between the best of them and its neighbours.
FRACTIONS, REFINED = (1.0, 0.6, 0.35), 4
#: Seeds of a random input, and how many singles and pairs are tried in full.
SEEDS, SINGLES, PAIRS = 2, 4, 3
#: So many of the best are rehearsed at most.
REHEARSED = 3

#: The score of an input that moves nothing.
NOTHING = 1e9

Watch = Callable[[str, int, int], None]
Rank = tuple[int, float]
Given = TypeVar("Given")
Found = TypeVar("Found")


@dataclass(frozen=True)
class Candidate:
    """An input tried in full.

    current (N,): what to apply, with the slow loop on if `centre`. forecast: on the believed plant. rank: parameters
    not determined, then the criterion; of the believed plant or of the one with high friction, whichever is worse.
    """

    shape: Shape
    amplitude: float
    current: np.ndarray = field(repr=False)
    centre: bool
    limits: tuple[LimitUse, ...]
    forecast: Forecast = field(repr=False)
    rank: Rank

    @property
    def words(self) -> str:
        return self.shape.words(self.amplitude)

    @property
    def score(self) -> float:
        """The criterion over the parameters that are determined."""
        return self.rank[1]

    @property
    def tightest(self) -> LimitUse | None:
        """The limit that the plant or one of its variations goes nearest to; None for a plant without limits."""
        return max(self.limits, key=lambda use: max(use.share, use.worst_share), default=None)


@dataclass(frozen=True)
class _Trial:
    """A shape over the screening's time: information (k, k) at an amplitude."""

    shape: Shape
    amplitude: float
    information: np.ndarray
    sizes: np.ndarray
    rank: Rank


def rank(information: np.ndarray, sizes: np.ndarray, criterion: str) -> Rank:
    """How many parameters are not determined, and the criterion over the others; sizes (k,) as in a Forecast."""
    covariance, null = invert(information)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # What is believed to be zero has no relative sd; it counts if nothing shows it.
    sized = sizes > 0.0
    fine = ~null & (~sized | (sd <= POOR * sizes))
    judged = fine & sized
    missing = int(np.count_nonzero(~fine))
    if not judged.any():
        return missing, np.inf
    if criterion == "worst":
        return missing, float(np.max(sd[judged] / sizes[judged]))
    inner = covariance[np.ix_(judged, judged)] / np.outer(sizes[judged], sizes[judged])
    _, logarithm = np.linalg.slogdet(inner)
    return missing, float(np.exp(0.5 * logarithm / np.count_nonzero(judged)))


class Search:
    """Singles over a short time, pairs of them by their information, then the best of both in full."""

    def __init__(
        self,
        plant: Plant,
        parameters: tuple[FreeParameter, ...],
        duration: float,
        cap: float | None,
        criterion: str,
        margin: float,
        spread: float,
        draws: int,
        seed: int,
        jobs: int | None,
        watch: Watch | None,
    ) -> None:
        self.plant, self.parameters, self.criterion = plant, parameters, criterion
        self.margin, self.seed, self.watch, self.cap = margin, seed, watch, cap
        self.time = plant.sample_time * np.arange(int(round(duration / plant.sample_time)) + 1)
        self.short = self.time[self.time <= SCREENING * (1 + 1e-9)]
        self.others = variations(plant, parameters, spread, draws, seed)
        self.jobs = jobs or os.cpu_count() or 1
        #: The plant that is judged in the screening: with high friction an input may fail to move anything.
        self.stiff = self.others[1] if len(self.others) > 1 else plant
        self.top = self._top()

    def run(self, kind: str) -> list[Candidate]:
        """Candidates tried in full, the best first. Raises InputError where there is none."""
        shapes = list(single_shapes(kind, self.seed, SEEDS))
        self._check_rest()
        trials = [trial for found in self._each("inputs", self._screen, shapes) for trial in found]
        if not trials and self.stiff is not self.plant:
            self.stiff = self.plant
            trials = [trial for found in self._each("inputs", self._screen, shapes) for trial in found]
        if not trials:
            raise InputError(self._nothing_moves())
        wanted = self._finalists(trials, kind)
        candidates = [c for c in self._each("in full", self._try, wanted) if c is not None]
        if not candidates:
            raise InputError(
                f"{self.plant.name}: no input keeps the limits for all {len(self.others)} plants that it may be and "
                "still moves shaft and rod; lower the spread of the parameters"
            )
        candidates.sort(key=lambda candidate: candidate.rank)
        hidden = [
            p.name
            for i, p in enumerate(self.parameters)
            if not any(c.forecast.fit.information[i, i] > 0.0 for c in candidates)
        ]
        if hidden:
            channels = ", ".join(self.plant.structure.system.outputs)
            raise InputError(f"{', '.join(hidden)}: no input shows it in {channels}; leave it out of what is free")
        return candidates

    def _each(self, stage: str, work: Callable[[Given], Found], items: Sequence[Given]) -> list[Found]:
        """Work on all items in threads (the engine runs outside Python's lock), in their order."""
        found: list[Found] = []
        with ThreadPoolExecutor(self.jobs) as pool:
            for result in pool.map(work, items):
                found.append(result)
                if self.watch is not None:
                    self.watch(stage, len(found), len(items))
        return found

    # What is allowed

    def _top(self) -> float | None:
        """The largest peak of the current that could be allowed."""
        limits, allowed = self.plant.limits, 1.0 - self.margin
        tops = [] if self.cap is None else [self.cap]
        if "motor_torque" in limits:
            tops.append(allowed * limits["motor_torque"].value / self.plant["K_T"])
        return min(tops) if tops else None

    def _run(
        self, time: np.ndarray, current: np.ndarray, plant: Plant | None = None, *, centre: bool = True
    ) -> Trajectory | None:
        """The believed plant, or another, with the rod held in its stroke; None if the run can't be made."""
        try:
            return record(plant or self.plant, time, current, sensor_noise=False, centre=centre)[1]
        except SimulationError:
            return None

    def _passed(self, run: Trajectory | None) -> str:
        """What stands against a run on the believed plant: a limit's name, "" for nothing."""
        if run is None or run.stopped:
            return "range"
        _, used = run_shares(run)
        if used and max(used.values()) > 1.0 - self.margin:
            return max(used, key=lambda name: used[name])
        return "amplitude" if self.cap is not None and np.max(np.abs(run.current)) > self.cap * (1 + 1e-9) else ""

    def _passed_by_all(self, current: np.ndarray, time: np.ndarray, others: int) -> str:
        """What stands against an input on the believed plant, or without margin on the first so many variations."""
        why = self._passed(self._run(time, current))
        if why:
            return why
        _, used = worst_of(self.others[:others], time, current, centre=True)
        worst = max(used, key=lambda name: used[name]) if used else ""
        return worst if worst and used[worst] > 1.0 else ""

    def _largest(self, passed: Callable[[float], str], top: float | None, refine: int) -> tuple[float, str]:
        """The largest amplitude [A] at which nothing is passed, within some percent, and what is beyond it.

        0 if there is none down to a hundredth of what was tried first.
        """
        low, high, beyond = 0.0, top or 1.0, ""
        while not (beyond := passed(high)) and top is None and high < 1e4:
            low, high = high, 2.0 * high
        if not beyond:
            return high, ""
        trial, least = high, 1e-2 * high
        while low == 0.0:
            trial *= 0.6
            if trial < least:
                return 0.0, beyond
            why = passed(trial)
            if why:
                beyond, high = why, trial
            else:
                low = trial
        for _ in range(refine):
            trial = float(np.sqrt(low * high))
            why = passed(trial)
            if why:
                beyond, high = why, trial
            else:
                low = trial
        return low, beyond

    def _check_rest(self) -> None:
        """Without any input the limits have to hold."""
        nothing = np.zeros(self.short.size)
        why = self._passed(self._run(self.short, nothing))
        if why in self.plant.limits:
            raise InputError(
                f"{self.plant.name}: {_limit_words(self.plant, why)} less a margin of {100 * self.margin:.0f} % is "
                "passed without any input; no input can keep it"
            )
        if why:
            raise InputError(f"{self.plant.name}: can't be simulated even without an input")
        why = self._passed_by_all(nothing, self.short, len(self.others))
        if why:
            raise InputError(
                f"{self.plant.name}: {_limit_words(self.plant, why)} is passed without any input by a plant that is a "
                "little other than believed (less friction does not hold the load); lower the load, or the spread of "
                "the parameters"
            )

    def _moves(self, run: Trajectory) -> bool:
        return all(np.any(run[contact.velocity] != 0.0) for contact in self.plant.structure.system.contacts)

    def _nothing_moves(self) -> str:
        """Why no shape is left: what stops each when it is made as large as it takes."""
        time, shape = self.short, next(iter(single_shapes("sine", self.seed, 1)))
        _, why = self._largest(lambda a: self._passed(self._run(time, shape.current(time, a))), self.top, 3)
        if why in self.plant.limits:
            within = f"within the limits, above all {_limit_words(self.plant, why)},"
        elif self.cap is not None:
            within = f"of no more than {self.cap:g} A"
        else:
            within = "within the limits"
        return (
            f"{self.plant.name}: no input {within} moves shaft and rod, so that nothing can be determined; look at "
            "limits, load and friction"
        )

    # What it tells

    def _screen(self, shape: Shape) -> list[_Trial]:
        """A shape over the short time, at fractions of the largest amplitude; empty if it moves nothing."""
        time = self.short
        # Of the variations the first alone: with its low friction it goes furthest.
        largest, _ = self._largest(lambda a: self._passed_by_all(shape.current(time, a), time, 1), self.top, 3)
        found: list[_Trial] = []

        def score(logarithm: float) -> float:
            """The criterion at a share of the largest amplitude; parameters that are not determined count most."""
            amplitude = float(np.exp(logarithm)) * largest
            here = self._forecast(self._run(time, shape.current(time, amplitude), self.stiff))
            if here is None:
                return NOTHING
            information = here.fit.information
            ranked = rank(information, here.sizes, self.criterion)
            found.append(_Trial(shape, amplitude, information, here.sizes, ranked))
            return min(1e3 * ranked[0] + ranked[1], NOTHING)

        scores = [score(float(np.log(fraction))) for fraction in FRACTIONS] if largest > 0.0 else []
        if not found:
            return []
        # One neighbour further on each side, down to half of the smallest.
        grid = np.log([1.0, *FRACTIONS, 0.5 * FRACTIONS[-1]])
        best = int(np.argmin(scores)) + 1
        minimize_scalar(
            score,
            bounds=(grid[best + 1], grid[best - 1]),
            method="bounded",
            options={"maxiter": REFINED, "xatol": 0.05},
        )
        return found

    def _forecast(self, run: Trajectory | None) -> Forecast | None:
        """What a run tells; None if it was not finished or moves nothing."""
        if run is None or run.stopped or not self._moves(run):
            return None
        try:
            return forecast_run(run, self.parameters)
        except SimulationError:
            return None

    def _finalists(self, trials: Sequence[_Trial], kind: str) -> list[tuple[Shape, float]]:
        """The best single of each kind (the best few, if one kind is wanted), the paper's noise, the best pairs."""
        best = sorted(trials, key=lambda trial: trial.rank)
        singles: dict[str, _Trial] = {}
        for trial in best:
            (part,) = trial.shape.parts
            singles.setdefault(part.kind if kind == "best" else str(trial.shape), trial)
            if part.kind == "noise" and part.pace == 1.0:
                singles.setdefault("as in the paper", trial)
        chosen = list(singles.values()) if kind == "best" else list(singles.values())[:SINGLES]
        wanted = list({id(trial): (trial.shape, trial.amplitude) for trial in chosen}.values())
        return wanted + (self._pairs(best[:60]) if kind == "best" else [])

    def _pairs(self, trials: Iterable[_Trial]) -> list[tuple[Shape, float]]:
        """The best pairs by the mean of their information, each pair of kinds once."""
        scored = sorted(
            (
                (rank(0.5 * (a.information + b.information), a.sizes, self.criterion), a, b)
                for a, b in combinations(trials, 2)
            ),
            key=lambda item: item[0],
        )
        kinds: dict[frozenset[str], tuple[Shape, float]] = {}
        for _, a, b in scored:
            kinds.setdefault(
                frozenset({a.shape.kind, b.shape.kind}), joined(a.shape, a.amplitude, b.shape, b.amplitude)
            )
            if len(kinds) == PAIRS:
                break
        return list(kinds.values())

    def _try(self, wanted: tuple[Shape, float]) -> Candidate | None:
        """A shape over the whole time at no more than an amplitude, on the plant and on its variations."""
        shape, most = wanted

        # The corners say most; the random draws are asked at the end.
        amplitude, _ = self._largest(lambda a: self._passed_by_all(shape.current(self.time, a), self.time, 2), most, 2)
        while amplitude > 1e-2 * most:
            raw = shape.current(self.time, amplitude)
            if not self._passed_by_all(raw, self.time, len(self.others)):
                break
            amplitude *= 0.9
        else:
            return None
        run = self._run(self.time, raw)
        here = self._forecast(run)
        if run is None or here is None:
            return None
        # Open loop is simpler to apply; the current is then what the loop has made of the shape.
        centre, current = False, run.current
        worst, used = worst_of(self.others, self.time, current, centre=False)
        if used and max(used.values()) > 1.0:
            centre, current = True, raw
            worst, used = worst_of(self.others, self.time, current, centre=True)
        values, own = run_shares(run)
        limits = tuple(
            LimitUse(
                name, limit.unit, limit.value, values[name], worst.get(name, values[name]), own[name],
                used.get(name, own[name]),
            )
            for name, limit in self.plant.limits.items()
        )  # fmt: skip
        found = rank(here.fit.information, here.sizes, self.criterion)
        if self.stiff is not self.plant:
            other = self._forecast(self._run(self.time, current, self.stiff, centre=centre))
            if other is None:
                found = (len(self.parameters), np.inf)
            else:
                found = max(found, rank(other.fit.information, other.sizes, self.criterion))
        return Candidate(shape, amplitude, current, centre, limits, here, found)

    def rehearsed(self, candidates: Sequence[Candidate], logs: int) -> tuple[Candidate, dict[int, Rehearsal]]:
        """The first candidate whose promise holds on the bench, and the rehearsals made; if none holds, the nearest."""
        made: dict[int, Rehearsal] = {}
        for number, candidate in enumerate(candidates[: REHEARSED if logs else 0]):
            made[number] = rehearse(
                candidate.forecast, self.parameters, candidate.current, centre=candidate.centre, logs=logs,
                seed=self.seed, jobs=self.jobs,
            )  # fmt: skip
            if self.watch is not None:
                self.watch("rehearsals", number + 1, min(REHEARSED, len(candidates)))
            if made[number].passed:
                return candidate, made
        return candidates[min(made, key=lambda number: made[number].ratio, default=0)], made

    def worst_relative(self, chosen: Candidate) -> dict[str, float]:
        """Name -> the largest relative sd that a variation of the plant would have under this input."""
        runs = [self._run(self.time, chosen.current, other, centre=chosen.centre) for other in self.others]
        found = [here.relative if here is not None else {} for here in self._each("variations", self._forecast, runs)]
        own = chosen.forecast.relative
        return {name: max(own[name], *(each.get(name, np.inf) for each in found)) for name in own} if found else own


def _limit_words(plant: Plant, name: str) -> str:
    limit = plant.limits[name]
    return f"the limit {name} = {limit.value / factor(SHOWN[name], limit.unit):.4g} {SHOWN[name]}"
