"""Search for the effects that explain a log: screening, refits, then sets of two and three effects.

The screening ranks the candidates, and the best are refitted in free run. Sets of two and three grow from several of
the best smaller sets, so that a wrong first choice can be corrected.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..physics.effects import CandidateEffect
from .hypothesis_model import Setting
from .objective import TEMPER, Objective
from .pool import Pool
from .records import Segment
from .refit import HypothesisFit, refine, refit, refit_by_windows, refit_until_converged
from .screening import Screening, screen

# The numbers below are engineering judgement: computing time against the risk of missing a cause.

#: Candidates to refit after the screening, fits to refine, sets to grow, candidates to add to each of these.
N_REFIT, N_REFINE, N_GROW, N_ADD = 12, 4, 3, 5
#: Hypotheses that are refitted to all training data after a search on a stretch of it.
N_MOVED = 6
#: Starts of one hypothesis that are refitted from the nominal model, and those of one that is added to a set.
N_STARTS, N_ADDED_STARTS = 4, 2
#: Sets grow if one more candidate is predicted to lower the cost by this much plus this share of what the best set
#: explains.
MIN_GAIN, MIN_GAIN_SHARE = 3.0, 0.004
#: Hypotheses up to so many times the lowest cost are refitted over windows: that has lowered costs by up to 15 %.
NEAR_BEST = 1.5
#: Hypotheses that are compared are refitted until a step lowers the cost by less than this, which is small against
#: `model_selection.MARGIN`; the chosen one is refitted further.
COMPARED = 0.5
#: Smallest predicted gain of a candidate that is added to a set.
MIN_ADDED_GAIN = 2.0
#: Sets of three are tried if the best pair costs less than this ratio of the best single effect, and the typical block
#: has more than this mean square, of which noise makes at most 1.
PAIR_RATIO, NOISE_LEVEL = 0.7, 1.2

Key = tuple[tuple[str, str | None], ...]


class Task(NamedTuple):
    """A refit: effects, start values, and a fit whose Jacobian holds there (None: that of the nominal plant)."""

    candidates: tuple[CandidateEffect, ...]
    start: Setting
    near: HypothesisFit | None = None

    def from_nominal(self) -> Task:
        """The same refit with the nominal parameters that no effect stands for at their nominal values."""
        names = {name for candidate in self.candidates for name in candidate.names}
        return self._replace(start={name: value for name, value in self.start.items() if name in names})


@dataclass(frozen=True)
class Hypotheses:
    """The best fit of every hypothesis so far.

    candidates: all that a hypothesis may contain. sensitivities: nominal parameter -> (n,) derivative of the residual
    there. residual: (n,) of the nominal model. fits: hypothesis -> fit.
    """

    objective: Objective
    candidates: tuple[CandidateEffect, ...]
    sensitivities: Mapping[str, np.ndarray] = field(repr=False)
    residual: np.ndarray = field(repr=False)
    fits: Mapping[Key, HypothesisFit] = field(default_factory=dict, repr=False)
    pool: Pool = field(default_factory=Pool, repr=False)

    @classmethod
    def initial(
        cls,
        objective: Objective,
        candidates: tuple[CandidateEffect, ...],
        sensitivities: Mapping[str, np.ndarray],
        pool: Pool,
    ) -> Hypotheses:
        """The start of a search, without fits."""
        (residual,) = objective.residuals([{}])
        assert residual is not None
        return cls(objective, candidates, sensitivities, residual, {}, pool)

    def best(self, size: int | None = None) -> list[HypothesisFit]:
        """Fits of hypotheses with `size` effects (None: of all), the lowest cost first."""
        chosen = [fit for fit in self.fits.values() if size is None or len(fit.candidates) == size]
        return sorted(chosen, key=lambda fit: fit.cost)

    @property
    def nominal(self) -> HypothesisFit:
        """The nominal model as a fit that changes nothing."""
        nominal, r = self.objective.nominal, self.residual
        values = dict(zip(nominal.names, nominal.values.tolist(), strict=True))
        jacobian = np.column_stack([self.sensitivities[name] for name in nominal.names]) * nominal.sd
        cost = TEMPER * self.objective.loss(r)
        return HypothesisFit((), values, cost, r, jacobian, self.objective.free_numbers(()))

    def screening(self, fit: HypothesisFit | None = None) -> Screening:
        """Responses to all candidates at the values of a fit, at those of the nominal plant by default."""
        residual, at = (self.residual, {}) if fit is None else (fit.residual, fit.values)
        return screen(self.objective, self.candidates, self.pool, residual, at)

    @property
    def sizes(self) -> list[int]:
        """Numbers of effects in the fitted hypotheses, from one on."""
        return sorted({len(key) for key in self.fits} - {0})

    def with_refits(self, tasks: Sequence[Task], stage: str, steps: int, renew_after: int = 0) -> Hypotheses:
        """Refit hypotheses from given values; of each hypothesis the better fit is kept."""

        def work(task: Task) -> HypothesisFit | None:
            candidates, start, near = task
            if near is None:
                own = {name for candidate in candidates for name in candidate.names}
                known = {name: column for name, column in self.sensitivities.items() if name not in own}
            else:
                known = near.sensitivities
            return refit(self.objective, candidates, start, known, steps=steps, renew_after=renew_after)

        return self.with_fits(self.pool.map(stage, work, tasks, lambda task: len(task.candidates)))

    def with_converged_refits(self, tasks: Sequence[Task], stage: str, windows: Segment | None = None) -> Hypotheses:
        """Refit hypotheses from given values until their costs no longer fall.

        windows: training data in short windows, for those near the best of them that leave more than noise, see
        `refit_by_windows`.
        """

        objective = replace(self.objective, converged=COMPARED)

        def work(task: Task) -> HypothesisFit | None:
            return refit_until_converged(objective, task.candidates, task.start)

        fits = self.pool.map(stage, work, tasks, lambda task: len(task.candidates))
        found = self.with_fits(fits)
        if windows is None or not any(fits):
            return found
        limit = NEAR_BEST * min(fit.cost for fit in fits if fit is not None)
        pairs = [(task, fit) for task, fit in zip(tasks, fits, strict=True) if fit is not None and fit.cost <= limit]
        near = [(task, fit) for task, fit in pairs if not self.objective.at_noise(fit.residual)]
        return found.with_fits(
            self.pool.map(stage, lambda pair: refit_by_windows(objective, windows, pair[0].start, pair[1]), near)
        )

    def with_compared_refits(
        self, tasks: Sequence[Task], stage: str, windows: Segment | None = None, beside: Sequence[Task] = ()
    ) -> Hypotheses:
        """Refit hypotheses that are compared: converged, and neither they nor those beside fit worse than a part.

        windows: see `with_converged_refits`.
        """
        return self.with_converged_refits(tasks, stage, windows).with_nested_refits([*beside, *tasks], stage)

    def with_fits(self, found: Iterable[HypothesisFit | None]) -> Hypotheses:
        """With fits added; of each hypothesis the better one is kept."""
        fits = dict(self.fits)
        for fit in found:
            if fit is not None:
                key = hypothesis_key(fit.candidates)
                if key not in fits or fit.cost < fits[key].cost:
                    fits[key] = fit
        return replace(self, fits=fits)

    def fits_of(self, tasks: Sequence[Task]) -> list[HypothesisFit]:
        """The best fits of the hypotheses of tasks, without those that could not be simulated."""
        keys = (hypothesis_key(task.candidates) for task in tasks)
        return [self.fits[key] for key in keys if key in self.fits]

    def with_nested_refits(self, tasks: Sequence[Task], stage: str) -> Hypotheses:
        """Refit hypotheses that fit worse than one with a part of their effects, from the values of that one.

        A hypothesis contains those with fewer effects, so that it has not reached its optimum.
        """
        again = []
        for fit in self.fits_of(tasks):
            effects = {(c.key, c.names) for c in fit.candidates}
            parts = [f for f in self.fits.values() if {(c.key, c.names) for c in f.candidates} < effects]
            best = min(parts, key=lambda part: part.cost, default=fit)
            if best.cost < fit.cost - COMPARED:
                start = {n: fit.values[n] for c in fit.candidates for n in c.names}
                # Where there is one, the neutral value of an effect's first number makes the two the same.
                first = {c.free[0].name: c.free[0].nominal for c in fit.candidates}
                start |= {name: value for name, value in first.items() if np.isfinite(value)}
                again.append(Task(fit.candidates, {**start, **best.values}))
        return self.with_converged_refits(again, stage) if again else self

    def refine(self, fits: Sequence[HypothesisFit], steps: int = 6) -> Hypotheses:
        """Continue fits with a new Jacobian, except for those that would not change."""
        todo = [fit for fit in fits if not fit.settled]
        return self.with_fits(self.pool.map("refitting", lambda fit: refine(self.objective, fit, steps), todo))

    def on_all_data(self, objective: Objective, sensitivities: Mapping[str, np.ndarray]) -> Hypotheses:
        """The best hypotheses that were found on a stretch, and the best of each size, refitted with another objective.

        sensitivities: of that objective, see `objective_of`.
        """
        best = {id(fit): fit for fit in [*self.best()[:N_MOVED], *(self.best(size)[0] for size in self.sizes)]}
        tasks = [Task((), {}), *(Task(fit.candidates, fit.values) for fit in best.values() if fit.candidates)]
        moved = Hypotheses.initial(objective, self.candidates, sensitivities, self.pool)
        moved = moved.with_refits(tasks, "all training data", steps=4)
        return moved.with_level_of(moved.best()[0])

    def with_level_of(self, fit: HypothesisFit) -> Hypotheses:
        """Take the typical block from this fit, and recompute the costs of all fits."""
        objective = replace(self.objective, level=self.objective.typical_level(fit.residual))
        fits = {key: known.with_level_of(objective) for key, known in self.fits.items()}
        return replace(self, objective=objective, fits=fits)


def search(hypotheses: Hypotheses, *, lumped: bool) -> tuple[Hypotheses, Screening]:
    """Fit single effects and pairs; sets of three too if the pairs leave much, or the model lacks dry friction.

    Returns the hypotheses and the last screening.
    """
    screening = hypotheses.screening()
    hypotheses = _fit_singles(hypotheses, screening)
    if lumped:
        # The best fit is so far from the nominal plant that its sensitivities are no longer valid.
        screening = hypotheses.screening(hypotheses.best()[0])
    hypotheses = _grow_sets(hypotheses, screening, 2)
    if lumped:
        hypotheses = _fit_missing_friction(hypotheses)
        screening = hypotheses.screening(hypotheses.best()[0])
    if lumped or _pairs_leave_much(hypotheses):
        hypotheses = _grow_sets(hypotheses, screening, 3)
    return hypotheses, screening


def _pairs_leave_much(hypotheses: Hypotheses) -> bool:
    """Whether pairs explain clearly more than single effects, and still leave more than noise."""
    costs = [fits[0].cost if (fits := hypotheses.best(size)) else np.inf for size in (1, 2)]
    return costs[1] < PAIR_RATIO * costs[0] and hypotheses.objective.level > NOISE_LEVEL


def _fit_singles(hypotheses: Hypotheses, screening: Screening) -> Hypotheses:
    """Refit the nominal parameters alone, then the single effects with the largest predicted gain."""
    hypotheses = hypotheses.with_refits([Task((), {})], "nominal parameters", steps=6)
    null = hypotheses.fits[()]
    hypotheses = hypotheses.with_level_of(null)
    null = hypotheses.fits[()]
    tasks: list[Task] = []
    seen: Counter[tuple[str, str | None]] = Counter()
    for gain in screening.gains(hypotheses.nominal):
        candidate = gain.candidate
        if seen[candidate.key] >= (N_STARTS if len(candidate.starts) > 1 else 1):
            continue
        seen[candidate.key] += 1
        tasks.append(Task((candidate,), gain.start({})))
        if len(tasks) >= N_REFIT:
            break
    tasks += [Task((gain.candidate,), gain.start(null.values)) for gain in screening.gains(null)[: N_REFIT // 2]]
    hypotheses = hypotheses.with_refits(tasks, "single effects", steps=3)
    # A hypothesis that explains less than the nominal parameters alone has not reached its optimum.
    worse = [fit for fit in hypotheses.best(1) if fit.cost > null.cost and not fit.candidates[0].shaped]
    worse = [fit for fit in worse if all(np.isfinite(f.nominal) for f in fit.candidates[0].free)]
    again = [Task(fit.candidates, null.values) for fit in worse]
    hypotheses = hypotheses.with_refits(again, "single effects", steps=3)
    hypotheses = hypotheses.with_level_of(hypotheses.best()[0])
    hypotheses = hypotheses.refine(hypotheses.best(1)[:N_REFINE])
    return hypotheses.with_level_of(hypotheses.best()[0])


def _grow_sets(hypotheses: Hypotheses, screening: Screening, size: int) -> Hypotheses:
    """Refit sets of `size` effects, grown from the best smaller ones, if the screening predicts a gain."""
    best = hypotheses.best(size - 1)
    if not best:
        return hypotheses
    explained = TEMPER * hypotheses.objective.loss(hypotheses.residual) - best[0].cost
    gains = screening.gains(best[0])
    if not gains or gains[0].decrease < MIN_GAIN + MIN_GAIN_SHARE * max(explained, 0.0):
        return hypotheses
    tasks: list[Task] = []
    seen = Counter(hypotheses.fits.keys())
    for base in best[:N_GROW]:
        added = 0
        for gain in screening.gains(base):
            candidates = (*base.candidates, gain.candidate)
            key = hypothesis_key(candidates)
            if gain.decrease < MIN_ADDED_GAIN or added >= N_ADD:
                break
            if seen[key] >= (N_ADDED_STARTS if len(gain.candidate.starts) > 1 else 1):
                continue
            added += 1
            seen[key] += 1
            tasks.append(Task(candidates, gain.start(base.values)))
    hypotheses = hypotheses.with_refits(tasks, f"sets of {size}", steps=3)
    hypotheses = hypotheses.refine(hypotheses.best(size)[: N_REFINE - 1])
    return hypotheses.with_level_of(hypotheses.best()[0])


def _fit_missing_friction(hypotheses: Hypotheses) -> Hypotheses:
    """Fit all effects that a model without dry friction lacks, starting from what the balances show.

    A single one of these effects explains so little that the search would not find the set.
    """
    start: dict[str, float] = {}
    for sought in hypotheses.objective.model.plant.structure.system.missing_effects:
        # Without those that are left out of the catalogue.
        members = tuple(c for id in sought for c in [c for c in hypotheses.candidates if c.id == id][:1])
        if not members:
            continue
        seen = {name: value for c in members for name, value in zip(c.names, c.starts[0], strict=True)}
        start = {**seen, **start}
        hypotheses = hypotheses.with_refits([Task(members, start)], "missing friction", steps=8, renew_after=1)
        key = hypothesis_key(members)
        if key not in hypotheses.fits:
            break
        start |= hypotheses.fits[key].values
        hypotheses = hypotheses.with_level_of(hypotheses.fits[key])
        hypotheses = hypotheses.refine([hypotheses.fits[key]])
        hypotheses = hypotheses.with_level_of(hypotheses.fits[key])
    return hypotheses


def hypothesis_key(candidates: Sequence[CandidateEffect]) -> Key:
    """Key of a set of candidates, whatever their order; two candidates of one effect differ in their parameters."""
    return tuple(sorted((f"{c.id}:{','.join(c.names)}", c.channel) for c in candidates))


def distinct_tasks(tasks: Iterable[Task]) -> list[Task]:
    """The first task of each hypothesis."""
    found: dict[Key, Task] = {}
    for task in tasks:
        found.setdefault(hypothesis_key(task.candidates), task)
    return list(found.values())
