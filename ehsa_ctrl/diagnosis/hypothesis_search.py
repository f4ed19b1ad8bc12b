"""From all candidate effects to the few that explain a log: screening by projection, refits, sets of two and three.

Screening asks by how much the cost would fall if a candidate's response were added freely while all nominal parameters
follow (the score test with nuisance parameters projected out). Promising candidates are refitted in free run. Sets of
two and three grow from several of the best smaller ones, so that no first choice is final.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from ..physics.effects import CandidateEffect
from .hypothesis_model import Setting
from .refit import TEMPER, HypothesisFit, Objective, refit

#: Candidates that are refitted after the screening, fits that are refined, sets that grow, candidates added to each.
REFITTED, REFINED, GROWN, ADDED = 12, 4, 3, 5
#: A set grows if one more candidate could lower the cost by this much, and this share of what the best set explains.
WORTH_GROWING, WORTH_GROWING_SHARE = 3.0, 0.004

Key = tuple[tuple[str, str | None], ...]
Watch = Callable[[str, int, int], None]
Task = tuple[tuple[CandidateEffect, ...], Setting]
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Pool:
    """Threads for the refits; the engine runs outside Python's lock. watch: gets stage, steps done, steps in all."""

    jobs: int = 1
    watch: Watch | None = None

    def map(self, stage: str, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        out: list[Result] = []
        with ThreadPoolExecutor(self.jobs) as threads:
            for result in threads.map(work, items):
                out.append(result)
                if self.watch is not None:
                    self.watch(stage, len(out), len(items))
        return out


@dataclass(frozen=True)
class Hypotheses:
    """The best fit of every hypothesis that was refitted.

    candidates: all that could be part of one. columns: nominal parameter -> (n,) derivative of the residual by one
    prior deviation. residual: (n,) of the nominal model.
    """

    objective: Objective
    candidates: tuple[CandidateEffect, ...]
    columns: Mapping[str, np.ndarray] = field(repr=False)
    residual: np.ndarray = field(repr=False)
    fits: Mapping[Key, HypothesisFit] = field(default_factory=dict, repr=False)
    pool: Pool = field(default_factory=Pool, repr=False)

    @classmethod
    def none_fitted(
        cls,
        objective: Objective,
        candidates: tuple[CandidateEffect, ...],
        columns: Mapping[str, np.ndarray],
        pool: Pool,
    ) -> Hypotheses:
        """Before the search."""
        (residual,) = objective.residuals([{}])
        assert residual is not None
        return cls(objective, candidates, columns, residual, {}, pool)

    def best(self, size: int | None = None) -> list[HypothesisFit]:
        """Fits in the order of cost, of one size or of all."""
        chosen = [fit for fit in self.fits.values() if size is None or len(fit.candidates) == size]
        return sorted(chosen, key=lambda fit: fit.cost)

    def refitted(self, tasks: Sequence[Task], stage: str, steps: int, fresh: int = 0) -> Hypotheses:
        """With hypotheses refitted from given values; the better fit of each stays."""

        def work(task: Task) -> HypothesisFit | None:
            return refit(self.objective, *task, self.columns, steps=steps, fresh=fresh)

        fits = dict(self.fits)
        for found in self.pool.map(stage, work, tasks):
            if found is not None:
                key = key_of(found.candidates)
                if key not in fits or found.cost < fits[key].cost:
                    fits[key] = found
        return replace(self, fits=fits)

    def refined(self, fits: Sequence[HypothesisFit], steps: int = 6) -> Hypotheses:
        """With fits continued to the minimum, all derivatives taken anew."""
        return self.refitted([(fit.candidates, fit.values) for fit in fits], "refitting", steps=steps, fresh=1)

    def at_level(self, fit: HypothesisFit) -> Hypotheses:
        """With the blocks of a fit as the typical ones; the costs of all fits follow."""
        objective = replace(self.objective, level=self.objective.typical_level(fit.residual))
        fits = {key: known.at_level_of(objective) for key, known in self.fits.items()}
        return replace(self, objective=objective, fits=fits)


@dataclass(frozen=True)
class Response:
    """What a candidate does to the residual from one of its starts.

    base: (n,) residual at which its columns are taken: that of the screening, or that at the start where neutral is
    infinite. columns: name -> (n,) derivative by one scale. values: those of the base.
    """

    candidate: CandidateEffect
    values: Setting
    base: np.ndarray = field(repr=False)
    columns: Mapping[str, np.ndarray] = field(repr=False)


@dataclass(frozen=True)
class Screening:
    """Responses of all candidates from one setting.

    columns (n, c): of all responses side by side; shifts (n, responses): each base less the residual of the setting.
    Products with all of them at once are many times faster than one by one.
    """

    responses: tuple[Response, ...]
    columns: np.ndarray = field(repr=False)
    shifts: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, responses: Sequence[Response], residual: np.ndarray) -> Screening:
        columns = np.column_stack([column for r in responses for column in r.columns.values()])
        return cls(tuple(responses), columns, np.column_stack([r.base - residual for r in responses]))

    def gains(
        self, hypotheses: Hypotheses, fit: HypothesisFit | None = None
    ) -> list[tuple[float, Response, np.ndarray]]:
        """Decrease of the cost by each response added to a fit (None: the nominal model), the largest first.

        The third is the candidate's step in its scales.
        """
        if fit is None:
            own, used, r = 0, set[tuple[str, str | None]](), hypotheses.residual
            names = list(hypotheses.objective.nominal.names)
            nuisance = np.column_stack([hypotheses.columns[n] for n in names])
            prior = np.zeros(len(names))
        else:
            own, used, r, nuisance = fit.own, {c.key for c in fit.candidates}, fit.residual, fit.jacobian
            names = [f.name for f in fit.free]
            prior = np.array([(fit.values[f.name] - f.nominal) / f.scale for f in fit.free])
            prior[:own] = 0.0
        ridge = np.where(np.arange(nuisance.shape[1]) < own, 1e-6, 1.0)
        among = TEMPER * (nuisance.T @ nuisance) + np.diag(ridge)
        across = TEMPER * (nuisance.T @ self.columns)
        here, there = TEMPER * (self.columns.T @ r), TEMPER * (nuisance.T @ r) + ridge * prior
        # The cost where the nominal parameters follow alone.
        without = TEMPER * float(r @ r) + float((ridge * prior) @ prior) - float(there @ np.linalg.solve(among, there))
        moved = TEMPER * (nuisance.T @ self.shifts)
        size = TEMPER * (float(r @ r) + 2.0 * (r @ self.shifts) + np.sum(self.shifts**2, axis=0))
        found, end = [], 0
        for number, response in enumerate(self.responses):
            begin, end = end, end + len(response.columns)
            if response.candidate.key in used or set(response.candidate.names) & set(names[:own]):
                continue
            C = self.columns[:, begin:end]
            # A parameter that is nominal too gives up its prior: its nuisance column is left out.
            keep = [i for i, n in enumerate(names) if n not in response.columns]
            own_block = TEMPER * (C.T @ C) + 1e-6 * np.eye(end - begin)
            full = np.block(
                [[own_block, across[keep, begin:end].T], [across[keep, begin:end], among[np.ix_(keep, keep)]]]
            )
            shift = self.shifts[:, number]
            g = np.concatenate([here[begin:end] + TEMPER * (C.T @ shift), there[keep] + moved[keep, number]])
            step = _step_within(response, -np.linalg.solve(full, g), full, g)
            after = float(size[number]) + float((ridge * prior)[keep] @ prior[keep])
            after += 2.0 * float(g @ step) + float(step @ full @ step)
            found.append((without - after, response, step[: end - begin]))
        return sorted(found, key=lambda row: -row[0])


def _step_within(response: Response, step: np.ndarray, full: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The step with the candidate's own numbers held within their bounds, the others following."""
    k = len(response.columns)
    free = [f for f in response.candidate.free if f.name in response.columns]
    low = np.array([(f.lower - response.values[f.name]) / f.scale for f in free])
    high = np.array([(f.upper - response.values[f.name]) / f.scale for f in free])
    own = np.clip(step[:k], low, high)
    if np.array_equal(own, step[:k]):
        return step
    rest = -np.linalg.solve(full[k:, k:], g[k:] + full[k:, :k] @ own)
    return np.concatenate([own, rest])


def screen(hypotheses: Hypotheses, at: Setting | None = None) -> Screening:
    """Simulate every candidate once from each of its starts, and its derivatives.

    at: values of the hypothesis to start from; the nominal plant by default.
    """
    objective, at = hypotheses.objective, at or {}
    zero = objective.residuals([at])[0] if at else hypotheses.residual
    assert zero is not None

    def respond(item: tuple[CandidateEffect, tuple[float, ...]]) -> Response | None:
        candidate, start = item
        if candidate.shaped:
            # Location and shape have no derivative at neutral: one column, from neutral to the start.
            values = dict(zip(candidate.names, start, strict=True))
            (moved,) = objective.residuals([{**at, **values}])
            if moved is None:
                return None
            column = (moved - zero) / (start[0] / candidate.free[0].scale)
            return Response(candidate, values, zero, {candidate.names[0]: column})
        base: np.ndarray | None
        if all(np.isfinite(f.nominal) for f in candidate.free):
            # From neutral, with a step as large as that to the start.
            base, values, others = zero, {f.name: f.nominal for f in candidate.free}, {}
            steps = [max(s - f.nominal, 0.0) or f.scale for s, f in zip(start, candidate.free, strict=True)]
        else:
            values = dict(zip(candidate.names, start, strict=True))
            base, others, steps = (
                objective.residuals([{**at, **values}])[0],
                values,
                [0.5 * f.scale for f in candidate.free],
            )
        if base is None:
            return None
        settings = [{**at, **others, f.name: values[f.name] + h} for f, h in zip(candidate.free, steps, strict=True)]
        columns = {
            f.name: (r - base) / (h / f.scale)
            for f, h, r in zip(candidate.free, steps, objective.residuals(settings), strict=True)
            if r is not None
        }
        return Response(candidate, values, base, columns) if columns or others else None

    items = [(candidate, start) for candidate in hypotheses.candidates for start in candidate.starts]
    return Screening.of([r for r in hypotheses.pool.map("screening", respond, items) if r is not None], zero)


def search(hypotheses: Hypotheses, *, lumped: bool) -> Hypotheses:
    """Singles, pairs, and sets of three where pairs leave much or where the model is known to lack much."""
    screening = screen(hypotheses)
    hypotheses = _singles(hypotheses, screening)
    if lumped:
        # So far from the nominal plant its derivatives do not show what is missing beside.
        screening = screen(hypotheses, hypotheses.best()[0].values)
    hypotheses = _grown(hypotheses, screening, 2)
    if lumped:
        hypotheses = _missing_friction(hypotheses)
        screening = screen(hypotheses, hypotheses.best()[0].values)
    if lumped or _pairs_leave_much(hypotheses):
        hypotheses = _grown(hypotheses, screening, 3)
    return hypotheses


def _pairs_leave_much(hypotheses: Hypotheses) -> bool:
    """Whether pairs explain clearly more than singles, and clearly more than noise is left."""
    costs = [fits[0].cost if (fits := hypotheses.best(size)) else np.inf for size in (1, 2)]
    return costs[1] < 0.7 * costs[0] and hypotheses.objective.level > 1.2


def _singles(hypotheses: Hypotheses, screening: Screening) -> Hypotheses:
    """Refit the nominal parameters alone, and the candidates that the screening finds promising."""
    hypotheses = hypotheses.refitted([((), {})], "nominal parameters", steps=6)
    null = hypotheses.fits[()]
    hypotheses = hypotheses.at_level(null)
    null = hypotheses.fits[()]
    tasks: list[Task] = []
    seen = set()
    for _, response, step in screening.gains(hypotheses):
        if response.candidate.key in seen and len(response.candidate.starts) < 2:
            continue
        seen.add(response.candidate.key)
        tasks.append(((response.candidate,), _start(response, step, {})))
        if len(tasks) >= REFITTED:
            break
    for _, response, step in screening.gains(hypotheses, null)[: REFITTED // 2]:
        tasks.append(((response.candidate,), _start(response, step, null.values)))
    hypotheses = hypotheses.refitted(tasks, "single effects", steps=3)
    # A hypothesis that contains the nominal parameters can't explain less than they do alone.
    worse = [fit for fit in hypotheses.best(1) if fit.cost > null.cost and not fit.candidates[0].shaped]
    worse = [fit for fit in worse if all(np.isfinite(f.nominal) for f in fit.candidates[0].free)]
    hypotheses = hypotheses.refitted([(fit.candidates, null.values) for fit in worse], "single effects", steps=3)
    hypotheses = hypotheses.at_level(hypotheses.best()[0])
    hypotheses = hypotheses.refined(hypotheses.best(1)[:REFINED])
    return hypotheses.at_level(hypotheses.best()[0])


def _grown(hypotheses: Hypotheses, screening: Screening, size: int) -> Hypotheses:
    """Sets of `size` from the best ones that are one smaller, unless nothing is left for one more to explain."""
    best = hypotheses.best(size - 1)
    if not best:
        return hypotheses
    explained = TEMPER * hypotheses.objective.loss(hypotheses.residual) - best[0].cost
    if screening.gains(hypotheses, best[0])[0][0] < WORTH_GROWING + WORTH_GROWING_SHARE * max(explained, 0.0):
        return hypotheses
    tasks: list[Task] = []
    seen = set(hypotheses.fits)
    for base in best[:GROWN]:
        added = 0
        for gain, response, step in screening.gains(hypotheses, base):
            candidates = (*base.candidates, response.candidate)
            key = key_of(candidates)
            if gain < 2.0 or added >= ADDED:
                break
            added += 1
            if key in seen and len(response.candidate.starts) < 2:
                continue
            seen.add(key)
            tasks.append((candidates, _start(response, step, base.values)))
    hypotheses = hypotheses.refitted(tasks, f"sets of {size}", steps=3)
    hypotheses = hypotheses.refined(hypotheses.best(size)[: REFINED - 1])
    return hypotheses.at_level(hypotheses.best()[0])


def _missing_friction(hypotheses: Hypotheses) -> Hypotheses:
    """All at once what a model without dry friction lacks, from what the balances show.

    One of these effects alone explains so little that no search would come to the set.
    """
    start: dict[str, float] = {}
    for sought in hypotheses.objective.model.plant.structure.system.lacking:
        members = tuple(next(c for c in hypotheses.candidates if c.id == id) for id in sought)
        seen = {name: value for c in members for name, value in zip(c.names, c.starts[0], strict=True)}
        start = {**seen, **start}
        hypotheses = hypotheses.refitted([(members, start)], "what a linear model lacks", steps=8, fresh=1)
        key = key_of(members)
        if key not in hypotheses.fits:
            break
        start |= hypotheses.fits[key].values
        hypotheses = hypotheses.at_level(hypotheses.fits[key])
        hypotheses = hypotheses.refined([hypotheses.fits[key]])
        hypotheses = hypotheses.at_level(hypotheses.fits[key])
    return hypotheses


def key_of(candidates: Sequence[CandidateEffect]) -> Key:
    """The same for the same set in any order; the free numbers distinguish two candidates of one effect."""
    return tuple(sorted((f"{c.id}:{','.join(c.names)}", c.channel) for c in candidates))


def _start(response: Response, step: np.ndarray, values: Setting) -> dict[str, float]:
    """Values of a set that a candidate joins with the step that the screening proposes."""
    free = {f.name: f for f in response.candidate.free}
    out = {**values, **{name: response.values[name] for name in free}}
    for name, z in zip(response.columns, step, strict=True):
        f = free[name]
        at = f.nominal if response.candidate.shaped else response.values[name]
        out[name] = float(np.clip(at + z * f.scale, f.lower, f.upper))
    return out
