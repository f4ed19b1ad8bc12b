"""From all suspects to the few that explain a log: screen by projection, refit, add, swap and drop.

Screening asks of each suspect by how much the cost would fall if its response could be added freely while all nominal
parameters follow (the score test with nuisance parameters projected out). What it finds promising is refitted in
free run. Sets of two and three grow from several of the best ones, so that no first pick is kept for good.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from .fit import TEMPER, Bench, Refit, refit
from .suspect import Suspect

#: How many suspects are refitted after the screening, how many of them to the end, how many sets are grown from.
REFITTED, FINISHED, BASES, ADDED = 12, 4, 3, 5
#: Sets grow on if one more could take away this much, and this share of what the best one explains.
WORTH_GROWING, WORTH_GROWING_SHARE = 3.0, 0.004

Key = tuple[tuple[str, str | None], ...]
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Response:
    """What a suspect does to the nominal residual from one of its starts.

    base: (n,) residual that its columns start from: the nominal one, or that at the start where neutral is infinitely
    far. columns: name -> (n,) derivative by one scale. values: at which base was taken.
    """

    suspect: Suspect
    values: Mapping[str, float]
    base: np.ndarray
    columns: Mapping[str, np.ndarray]


@dataclass
class Search:
    """A bench, the suspects, and every hypothesis that was refitted so far."""

    bench: Bench
    suspects: tuple[Suspect, ...]
    nominal_columns: Mapping[str, np.ndarray]
    jobs: int = 2
    watch: Callable[[str, int, int], None] | None = None
    residual: np.ndarray = field(default_factory=lambda: np.zeros(0))
    responses: list[Response] = field(default_factory=list)
    columns: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    shifts: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    fits: dict[Key, Refit] = field(default_factory=dict)

    def best(self, size: int | None = None) -> list[Refit]:
        """Refits, the cheapest first, of one size or of all."""
        chosen = [fit for fit in self.fits.values() if size is None or len(fit.suspects) == size]
        return sorted(chosen, key=lambda fit: fit.cost)

    def respond(self, at: Mapping[str, float] | None = None) -> None:
        """Simulate every suspect once from each of its starts, and the finite ones' derivatives.

        at: values of the hypothesis to start from; the nominal plant by default.
        """
        at = at or {}
        zero = self.bench.residuals([at])[0]
        assert zero is not None
        if not at:
            self.residual = zero
        asked: list[tuple[Suspect, tuple[float, ...]]] = [(s, start) for s in self.suspects for start in s.starts]

        def one(item: tuple[Suspect, tuple[float, ...]]) -> Response | None:
            suspect, start = item
            values = dict(zip(suspect.names, start, strict=True))
            moved = [np.isfinite(f.nominal) for f in suspect.free]
            nested = all(moved) and not suspect.shaped
            if nested:
                settings = []
                steps = []
                for f in suspect.free:
                    h = max(start[suspect.names.index(f.name)] - f.nominal, 0.0) or f.scale
                    settings.append({**at, f.name: f.nominal + h})
                    steps.append(h / f.scale)
                columns = {}
                for f, h, r in zip(suspect.free, steps, self.bench.residuals(settings), strict=True):
                    if r is not None:
                        columns[f.name] = (r - zero) / h
                return Response(suspect, {f.name: f.nominal for f in suspect.free}, zero, columns) if columns else None
            base = self.bench.residuals([{**at, **values}])[0]
            if base is None:
                return None
            columns = {}
            if suspect.shaped:
                columns = {suspect.names[0]: (base - zero) / (start[0] / suspect.free[0].scale)}
                return Response(suspect, values, zero, columns)
            settings = [{**at, **values, f.name: values[f.name] + 0.5 * f.scale} for f in suspect.free]
            for f, r in zip(suspect.free, self.bench.residuals(settings), strict=True):
                if r is not None:
                    columns[f.name] = (r - base) / 0.5
            return Response(suspect, values, base, columns)

        self.responses = [r for r in self._map("screening", one, asked) if r is not None]
        # All columns side by side, and how far each response's base is from the nominal residual: products of all of
        # them at once are many times faster than one by one.
        self.columns = np.column_stack([column for r in self.responses for column in r.columns.values()])
        self.shifts = np.column_stack([r.base - zero for r in self.responses])

    def gains(self, fit: Refit | None = None) -> list[tuple[float, Response, np.ndarray]]:
        """Cost that each response would take away, added to a refit (the null without): largest first.

        The third is the suspect's step in its scales.
        """
        own = fit.own if fit is not None else 0
        used = set() if fit is None else {s.key for s in fit.suspects}
        if fit is None:
            nuisance = np.column_stack([self.nominal_columns[n] for n in self.bench.nominal.names])
            r, pull = self.residual, np.zeros(nuisance.shape[1])
            taken: list[str] = []
        else:
            nuisance = fit.jacobian
            r = fit.residual
            taken = [f.name for f in fit.frees[:own]]
            pull = np.array([(fit.values[f.name] - f.nominal) / f.scale for f in fit.frees])
            pull[:own] = 0.0
        ridge = np.where(np.arange(nuisance.shape[1]) < own, 1e-6, 1.0)
        names = [f.name for f in fit.frees] if fit is not None else list(self.bench.nominal.names)

        among = TEMPER * (nuisance.T @ nuisance) + np.diag(ridge)
        across = TEMPER * (nuisance.T @ self.columns)
        here, there = TEMPER * (self.columns.T @ r), TEMPER * (nuisance.T @ r) + ridge * pull
        # What is left where the nominal parameters follow alone.
        without = TEMPER * float(r @ r) + float((ridge * pull) @ pull) - float(there @ np.linalg.solve(among, there))
        moved = TEMPER * (nuisance.T @ self.shifts)
        size = TEMPER * (float(r @ r) + 2.0 * (r @ self.shifts) + np.sum(self.shifts**2, axis=0))
        found, end = [], 0
        for number, response in enumerate(self.responses):
            begin, end = end, end + len(response.columns)
            if response.suspect.key in used or set(response.suspect.names) & set(taken):
                continue
            C = self.columns[:, begin:end]
            # A symbol that is a nominal parameter too gives up its prior: its column there is left out.
            keep = [i for i, n in enumerate(names) if n not in response.columns]
            own_block = TEMPER * (C.T @ C) + 1e-6 * np.eye(end - begin)
            full = np.block(
                [[own_block, across[keep, begin:end].T], [across[keep, begin:end], among[np.ix_(keep, keep)]]]
            )
            shift = self.shifts[:, number]
            g = np.concatenate([here[begin:end] + TEMPER * (C.T @ shift), there[keep] + moved[keep, number]])
            step = self._within(response, -np.linalg.solve(full, g), full, g)
            after = float(size[number]) + float((ridge * pull)[keep] @ pull[keep])
            after += 2.0 * float(g @ step) + float(step @ full @ step)
            found.append((without - after, response, step[: end - begin]))
        return sorted(found, key=lambda row: -row[0])

    @staticmethod
    def _within(response: Response, step: np.ndarray, full: np.ndarray, g: np.ndarray) -> np.ndarray:
        """The step with the suspect's own numbers held within their bounds, the others following."""
        k = len(response.columns)
        frees = [f for f in response.suspect.free if f.name in response.columns]
        low = np.array([(f.lower - response.values[f.name]) / f.scale for f in frees])
        high = np.array([(f.upper - response.values[f.name]) / f.scale for f in frees])
        own = np.clip(step[:k], low, high)
        if np.array_equal(own, step[:k]):
            return step
        rest = -np.linalg.solve(full[k:, k:], g[k:] + full[k:, :k] @ own)
        return np.concatenate([own, rest])

    def fit(
        self, tasks: Iterable[tuple[tuple[Suspect, ...], Mapping[str, float]]], what: str, steps: int, fresh: int = 0
    ) -> None:
        """Refit hypotheses from given values, and keep the best of each."""

        def one(task: tuple[tuple[Suspect, ...], Mapping[str, float]]) -> Refit | None:
            suspects, start = task
            return refit(self.bench, suspects, start, self.nominal_columns, steps=steps, fresh=fresh)

        for found in self._map(what, one, list(tasks)):
            if found is None:
                continue
            key = key_of(found.suspects)
            if key not in self.fits or found.cost < self.fits[key].cost:
                self.fits[key] = found

    def singles(self) -> None:
        """Refit what the screening finds promising."""
        self.fit([((), {})], "nominal parameters", steps=6)
        null = self.fits[()]
        self.settle(null)
        tasks, seen = [], set()
        for _, response, step in self.gains():
            if response.suspect.key in seen and len(response.suspect.starts) < 2:
                continue
            seen.add(response.suspect.key)
            tasks.append(((response.suspect,), _start(response, step, {})))
            if len(tasks) >= REFITTED:
                break
        for _, response, step in self.gains(null)[: REFITTED // 2]:
            tasks.append(((response.suspect,), _start(response, step, null.values)))
        self.fit(tasks, "single effects", steps=3)
        # Whoever holds the nominal parameters can't explain less than they do alone.
        worse = [fit for fit in self.best(1) if fit.cost > null.cost and not fit.suspects[0].shaped]
        worse = [fit for fit in worse if all(np.isfinite(f.nominal) for f in fit.suspects[0].free)]
        self.fit([(fit.suspects, null.values) for fit in worse], "single effects", steps=3)
        self.settle(self.best()[0])
        self.finish(self.best(1)[:FINISHED])
        self.settle(self.best()[0])

    def settle(self, fit: Refit) -> None:
        """Take the blocks of a fit for the usual ones from now on; costs of all fits follow."""
        self.bench.level = self.bench.usual(fit.residual)
        for known in self.fits.values():
            known.cost = TEMPER * self.bench.loss(known.residual) + pulls(known)

    def finish(self, fits: Sequence[Refit], steps: int = 6) -> None:
        """Go on to the minimum, with all derivatives taken anew."""
        self.fit([(fit.suspects, fit.values) for fit in fits], "refitting", steps=steps, fresh=1)

    def grow(self, size: int) -> None:
        """Sets of `size` from the best ones that are one smaller, unless nothing is left for one more to explain."""
        best = self.best(size - 1)
        if not best or self.gains(best[0])[0][0] < self._enough(best[0]):
            return
        tasks = []
        seen = set(self.fits)
        for base in self.best(size - 1)[:BASES]:
            added = 0
            for gain, response, step in self.gains(base):
                suspects = (*base.suspects, response.suspect)
                key = key_of(suspects)
                if gain < 2.0 or added >= ADDED:
                    break
                added += 1
                if key in seen and len(response.suspect.starts) < 2:
                    continue
                seen.add(key)
                tasks.append((suspects, _start(response, step, base.values)))
        self.fit(tasks, f"sets of {size}", steps=3)
        self.finish(self.best(size)[: FINISHED - 1])
        self.settle(self.best()[0])

    def _enough(self, fit: Refit) -> float:
        explained = TEMPER * self.bench.loss(self.residual) - fit.cost
        return WORTH_GROWING + WORTH_GROWING_SHARE * max(explained, 0.0)

    def missing(self) -> None:
        """All at once what a model without dry friction leaves out, from what the balances show.

        One of them alone explains so little that no search would come this way.
        """
        start: dict[str, float] = {}
        for sought in self.bench.twin.plant.structure.system.lacking:
            members = tuple(next(s for s in self.suspects if s.id == id) for id in sought)
            seen = {name: value for s in members for name, value in zip(s.names, s.starts[0], strict=True)}
            start = {**seen, **start}
            self.fit([(members, start)], "what a linear model lacks", steps=8, fresh=1)
            fit = self.fits.get(key_of(members))
            if fit is None:
                return
            start |= fit.values
            self.settle(fit)
            self.finish([fit])
            self.settle(self.fits[key_of(members)])

    def _map(self, what: str, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Work on items in threads, telling the watcher; the engine runs outside Python's lock."""
        out: list[Result] = []
        with ThreadPoolExecutor(self.jobs) as pool:
            for result in pool.map(work, items):
                out.append(result)
                if self.watch is not None:
                    self.watch(what, len(out), len(items))
        return out


def pulls(fit: Refit) -> float:
    """Sum of squares of how far the nominal parameters went, in prior deviations."""
    return float(sum(((fit.values[f.name] - f.nominal) / f.scale) ** 2 for f in fit.frees[fit.own :]))


def key_of(suspects: Sequence[Suspect]) -> Key:
    """The same for the same set in any order; two suspects of one id with other symbols are told apart by them."""
    return tuple(sorted((f"{s.id}:{','.join(s.names)}", s.channel) for s in suspects))


def _start(response: Response, step: np.ndarray, values: Mapping[str, float]) -> dict[str, float]:
    """Values of a set grown by a suspect at the step that the screening proposes."""
    out = dict(values)
    for f in response.suspect.free:
        out[f.name] = response.values[f.name]
    for name, z in zip(response.columns, step, strict=True):
        f = next(f for f in response.suspect.free if f.name == name)
        at = f.nominal if response.suspect.shaped else response.values[name]
        out[name] = float(np.clip(at + z * f.scale, f.lower, f.upper))
    return out
