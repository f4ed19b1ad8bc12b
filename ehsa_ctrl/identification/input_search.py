"""Search over inputs for an experiment: which of them keep the limits and give the most information."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from ..core.errors import InputError, SimulationError
from ..plant.plant import Plant
from ..simulation.trajectory import Trajectory
from .input_limits import (
    MIN_AMPLITUDE,
    AdmissibleRuns,
    LimitUse,
    largest_amplitude,
    limit_words,
    reached_limits,
    variations,
    worst_of,
)
from .input_shapes import InputShape, joined, single_shapes
from .parameters import FreeParameter
from .predicted_accuracy import MonteCarloCheck, PredictedAccuracy, check_accuracy, predict_accuracy
from .uncertainty import POOR, invert

CRITERIA = ("worst", "D")
#: Inputs are screened over at most this time [s]: what is better in 8 s is mostly better in 60 s.
SCREENING = 8.0
#: Shares of the largest amplitude that are tried first, because friction shows better at slow motion, and the number of
#: further runs between the best of them and its neighbours.
FRACTIONS, N_REFINE = (1.0, 0.6, 0.35), 4
#: Seeds of a random input, and how many single shapes and pairs are tried in full.
N_SEEDS, N_SINGLES, N_PAIRS = 2, 4, 3
#: Pairs are formed of this many of the best screened inputs.
N_PAIRED = 60
#: Largest number of candidates that are checked on simulated logs.
N_CHECK = 3
#: Score of an input that moves nothing.
NO_MOTION = 1e9

Watch = Callable[[str, int, int], None]
Rank = tuple[int, float]
Given = TypeVar("Given")
Found = TypeVar("Found")


@dataclass(frozen=True)
class InputCandidate:
    """An input tried in full.

    current (N,): what to apply, with the slow loop on if `centre`. forecast: accuracy for the nominal plant. rank:
    number of undetermined parameters, then the criterion; the worse of the nominal plant and the one with high
    friction.
    """

    shape: InputShape
    amplitude: float
    current: np.ndarray = field(repr=False)
    centre: bool
    limits: tuple[LimitUse, ...]
    forecast: PredictedAccuracy = field(repr=False)
    rank: Rank

    @property
    def words(self) -> str:
        return self.shape.words(self.amplitude, self.forecast.run.plant.structure.system.drive_unit)

    @property
    def score(self) -> float:
        """The criterion over the parameters that are determined."""
        return self.rank[1]

    @property
    def tightest(self) -> LimitUse | None:
        """The limit that the plant or one of its variations comes closest to; None for a plant without limits."""
        return max(self.limits, key=lambda use: max(use.share, use.worst_share), default=None)


@dataclass(frozen=True)
class ScreenedInput:
    """A shape over the screening time: information (k, k) at an amplitude."""

    shape: InputShape
    amplitude: float
    information: np.ndarray
    sizes: np.ndarray
    rank: Rank


def rank(information: np.ndarray, sizes: np.ndarray, criterion: str) -> Rank:
    """Number of undetermined parameters, and the criterion over the others; sizes (k,) as for PredictedAccuracy."""
    covariance, null = invert(information)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # A nominal value of zero has no relative sd; such a parameter counts only where nothing shows it.
    sized = sizes > 0.0
    determined = ~null & (~sized | (sd <= POOR * sizes))
    scored = determined & sized
    missing = int(np.count_nonzero(~determined))
    if not scored.any():
        return missing, np.inf
    if criterion == "worst":
        return missing, float(np.max(sd[scored] / sizes[scored]))
    inner = covariance[np.ix_(scored, scored)] / np.outer(sizes[scored], sizes[scored])
    _, logarithm = np.linalg.slogdet(inner)
    return missing, float(np.exp(0.5 * logarithm / np.count_nonzero(scored)))


@dataclass(frozen=True)
class InputSearch:
    """Single shapes over a short time, pairs of them by their information, then the best of both in full.

    Arguments as for `design_experiment`.
    """

    plant: Plant
    parameters: tuple[FreeParameter, ...]
    duration: float
    amplitude: float | None
    criterion: str
    margin: float
    spread: float
    draws: int
    seed: int
    jobs: int | None = None
    watch: Watch | None = None

    @cached_property
    def time(self) -> np.ndarray:
        dt = self.plant.sample_time
        return dt * np.arange(int(round(self.duration / dt)) + 1)

    @cached_property
    def short(self) -> np.ndarray:
        """The screening time."""
        return self.time[self.time <= SCREENING * (1 + 1e-9)]

    @cached_property
    def others(self) -> list[Plant]:
        return variations(self.plant, self.parameters, self.spread, self.draws, self.seed)

    @cached_property
    def stiff(self) -> Plant:
        """The plant for the screening: with high friction an input may fail to move anything."""
        return self.others[1] if len(self.others) > 1 else self.plant

    @cached_property
    def runs(self) -> AdmissibleRuns:
        return AdmissibleRuns(self.plant, self.others, self.margin, self.amplitude)

    def candidates(self, kind: str) -> list[InputCandidate]:
        """Inputs tried in full, the best first. Raises InputError where there is none."""
        shapes = list(single_shapes(kind, self.seed, N_SEEDS))
        self.runs.check_rest(self.short)
        screening, screened = self.stiff, self._screen_all(shapes, self.stiff)
        if not screened and self.stiff is not self.plant:
            screening, screened = self.plant, self._screen_all(shapes, self.plant)
        if not screened:
            raise InputError(self._nothing_moves())
        wanted = self._finalists(screened, kind)
        tried = self._each("in full", lambda one: self._try(*one, screening), wanted)
        found = sorted((c for c in tried if c is not None), key=lambda candidate: candidate.rank)
        if not found:
            raise InputError(
                f"{self.plant.name}: no input that moves shaft and rod keeps the limits for all {len(self.others)} "
                "variations of the plant; lower the spread of the parameters"
            )
        shown = np.any([np.diag(c.forecast.fit.information) > 0.0 for c in found], axis=0)
        hidden = [p.name for p, seen in zip(self.parameters, shown, strict=True) if not seen]
        if hidden:
            channels = ", ".join(self.plant.structure.system.outputs)
            raise InputError(f"{', '.join(hidden)}: no input shows it in {channels}; leave it out of what is free")
        return found

    def checked(
        self, candidates: Sequence[InputCandidate], logs: int
    ) -> tuple[InputCandidate, dict[int, MonteCarloCheck]]:
        """The first candidate that passes the check on simulated logs, else the one with the smallest errors; and the
        checks made."""
        made: dict[int, MonteCarloCheck] = {}
        for number, candidate in enumerate(candidates[: N_CHECK if logs else 0]):
            made[number] = check_accuracy(
                candidate.forecast, self.parameters, candidate.current, centre=candidate.centre, logs=logs,
                seed=self.seed, jobs=self._threads,
            )  # fmt: skip
            if self.watch is not None:
                self.watch("rehearsals", number + 1, min(N_CHECK, len(candidates)))
            if made[number].passed:
                return candidate, made
        return candidates[min(made, key=lambda number: made[number].ratio, default=0)], made

    def worst_relative(self, chosen: InputCandidate) -> dict[str, float]:
        """Name -> the largest relative sd over the plant and its variations under this input."""
        runs = [self.runs.run(self.time, chosen.current, other, centre=chosen.centre) for other in self.others]
        found = [here.relative if here is not None else {} for here in self._each("variations", self._accuracy, runs)]
        own = chosen.forecast.relative
        return {name: max(own[name], *(each.get(name, np.inf) for each in found)) for name in own} if found else own

    @property
    def _threads(self) -> int:
        return self.jobs or os.cpu_count() or 1

    def _each(self, stage: str, work: Callable[[Given], Found], items: Sequence[Given]) -> list[Found]:
        """Work on all items in threads (the engine runs outside Python's lock), in their order."""
        found: list[Found] = []
        with ThreadPoolExecutor(self._threads) as pool:
            for result in pool.map(work, items):
                found.append(result)
                if self.watch is not None:
                    self.watch(stage, len(found), len(items))
        return found

    def _nothing_moves(self) -> str:
        """The sentence for the case that no shape moves the plant: what limits a large sine."""
        time, shape = self.short, next(single_shapes("sine", self.seed, 1))
        _, why = largest_amplitude(
            lambda a: self.runs.exceeded(self.runs.run(time, shape.current(time, a))), self.runs.largest_peak, 3
        )
        within = "within the limits"
        if why in self.plant.limits:
            within = f"within the limits, above all {limit_words(self.plant, why)},"
        elif self.amplitude is not None:
            within = f"of no more than {self.amplitude:g} {self.plant.structure.system.drive_unit}"
        return (
            f"{self.plant.name}: no input {within} moves shaft and rod, so nothing can be determined; check limits, "
            "load and friction"
        )

    # Information

    def _accuracy(self, run: Trajectory | None) -> PredictedAccuracy | None:
        """The accuracy from a run; None if it is incomplete or leaves shaft or rod at rest."""
        if run is None or run.stopped:
            return None
        if not all(np.any(run[contact.velocity] != 0.0) for contact in self.plant.structure.system.contacts):
            return None
        try:
            return predict_accuracy(run, self.parameters)
        except SimulationError:
            return None

    def _screen_all(self, shapes: Sequence[InputShape], plant: Plant) -> list[ScreenedInput]:
        return [one for found in self._each("inputs", lambda s: self.screen(s, plant), shapes) for one in found]

    def screen(self, shape: InputShape, plant: Plant) -> list[ScreenedInput]:
        """A shape over the short time, at fractions of the largest amplitude; empty if it moves nothing."""
        time = self.short
        # The first variation is enough here: with its low friction it moves furthest.
        largest, _ = largest_amplitude(
            lambda a: self.runs.exceeded_by_any(shape.current(time, a), time, 1), self.runs.largest_peak, 3
        )
        found: list[ScreenedInput] = []

        def score(logarithm: float) -> float:
            """The criterion at a share of the largest amplitude; undetermined parameters count most."""
            amplitude = float(np.exp(logarithm)) * largest
            here = self._accuracy(self.runs.run(time, shape.current(time, amplitude), plant))
            if here is None:
                return NO_MOTION
            information = here.fit.information
            ranked = rank(information, here.sizes, self.criterion)
            found.append(ScreenedInput(shape, amplitude, information, here.sizes, ranked))
            return min(1e3 * ranked[0] + ranked[1], NO_MOTION)

        scores = [score(float(np.log(fraction))) for fraction in FRACTIONS] if largest > 0.0 else []
        if found:
            # One neighbour more on each side, down to half of the smallest.
            grid = np.log([1.0, *FRACTIONS, 0.5 * FRACTIONS[-1]])
            best = int(np.argmin(scores)) + 1
            options = {"maxiter": N_REFINE, "xatol": 0.05}
            minimize_scalar(score, bounds=(grid[best + 1], grid[best - 1]), method="bounded", options=options)
        return found

    def _finalists(self, screened: Sequence[ScreenedInput], kind: str) -> list[tuple[InputShape, float]]:
        """The best single of each kind (the best few, if one kind is wanted), the paper's noise, the best pairs."""
        best = sorted(screened, key=lambda one: one.rank)
        singles: dict[str, ScreenedInput] = {}
        for one in best:
            (part,) = one.shape.parts
            singles.setdefault(part.kind if kind == "best" else str(one.shape), one)
            if part.kind == "noise" and part.pace == 1.0:
                singles.setdefault("as in the paper", one)
        chosen = list(singles.values()) if kind == "best" else list(singles.values())[:N_SINGLES]
        wanted = list({id(one): (one.shape, one.amplitude) for one in chosen}.values())
        return wanted + (self._pairs(best[:N_PAIRED]) if kind == "best" else [])

    def _pairs(self, screened: Sequence[ScreenedInput]) -> list[tuple[InputShape, float]]:
        """The best pairs by the mean of their information, each pair of kinds once."""
        scored = sorted(
            (
                (rank(0.5 * (a.information + b.information), a.sizes, self.criterion), a, b)
                for a, b in combinations(screened, 2)
            ),
            key=lambda item: item[0],
        )
        kinds: dict[frozenset[str], tuple[InputShape, float]] = {}
        for _, a, b in scored:
            pair = frozenset({a.shape.kind, b.shape.kind})
            kinds.setdefault(pair, joined(a.shape, a.amplitude, b.shape, b.amplitude))
            if len(kinds) == N_PAIRS:
                break
        return list(kinds.values())

    def _try(self, shape: InputShape, most: float, screening: Plant) -> InputCandidate | None:
        """A shape over the whole time at no more than an amplitude, on the plant and on its variations."""
        time = self.time
        # The two corners are the hardest variations; the random ones are checked at the end.
        amplitude, _ = largest_amplitude(lambda a: self.runs.exceeded_by_any(shape.current(time, a), time, 2), most, 2)
        while amplitude > MIN_AMPLITUDE * most:
            raw = shape.current(time, amplitude)
            if not self.runs.exceeded_by_any(raw, time, len(self.others)):
                break
            amplitude *= 0.9
        else:
            return None
        run = self.runs.run(time, raw)
        here = self._accuracy(run)
        if run is None or here is None:
            return None
        # Open loop is simpler to apply; its current is the shape with what the loop has added.
        centre, current = False, run.current
        worst = worst_of(self.others, time, current, centre=False)
        if worst.shares and max(worst.shares.values()) > 1.0:
            centre, current = True, raw
            worst = worst_of(self.others, time, current, centre=True)
        values, own = reached_limits(run)
        limits = tuple(
            LimitUse(
                name, limit.unit, limit.value, values[name], worst.values.get(name, values[name]), own[name],
                worst.shares.get(name, own[name]),
            )
            for name, limit in self.plant.limits.items()
        )  # fmt: skip
        found = rank(here.fit.information, here.sizes, self.criterion)
        if screening is not self.plant:
            other = self._accuracy(self.runs.run(time, current, screening, centre=centre))
            if other is None:
                found = (len(self.parameters), np.inf)
            else:
                found = max(found, rank(other.fit.information, other.sizes, self.criterion))
        return InputCandidate(shape, amplitude, current, centre, limits, here, found)
