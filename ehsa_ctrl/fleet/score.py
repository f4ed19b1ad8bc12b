"""What one log says of every parameter and effect, from one linearisation of the nominal model: about a second.

A diagnosis refits every hypothesis, which takes too long for thousands of logs. Here the log is simulated in short
windows, once for each parameter of the plant and once for each candidate effect. The parameters of the plant take three
Gauss-Newton steps; around that point a quadratic function replaces the log-likelihood: its gradient (the score) and its
curvature (the information). This is the score or Lagrange multiplier test: C. R. Rao, "Large sample tests of
statistical hypotheses concerning several parameters", Proc. Cambridge Philosophical Society 44 (1948).

To that order, score and information are all that a log says. The logs of a rig are combined by adding them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..core.parallel import one_blas_thread
from ..diagnosis.objective import STEP, ResidualScale
from ..diagnosis.prepared_logs import prepare_logs, segment_candidates
from ..diagnosis.records import Record, Segment, run_records
from ..diagnosis.validation_segment import windows_of
from ..diagnosis.verdict_text import name_of
from ..physics.effects import CandidateEffect
from ..plant.arrays import needed_to_simulate
from ..plant.plant import Plant

# The constants without another reason are engineering judgement.

#: Length of a block of scores [s], longer than the correlation of the residuals of a slightly wrong model, mostly.
BLOCK = 0.5
#: Largest number of starting points of an effect whose place or level is unknown.
MOST_STARTS = 5
#: Shifts of pressure level [Pa] and position [m] at the start of a window, for the derivatives by them.
START_SHIFTS = {"pressure": 2e4, "position": 1e-4}
#: Gauss-Newton steps of the plant's parameters, and how far they lead, in prior standard deviations of each.
STEPS, LONGEST_STEP = 3, 4.0
#: Smallest information of a direction, as a share of what it had before the start of each window was estimated. Below,
#: the log can't tell it from a shifted start.
LEAST_SHARE = 1e-6

#: Residuals (channels, samples) of each window.
Residuals = list[np.ndarray]


@dataclass(frozen=True)
class LogScore:
    """Score and information of one log.

    -2 log-likelihood of deviations x (k,) from the nominal plant: constant - 2 score' x + x' information x, divided by
    `dispersion`.

    Attributes
    ----------
    names: (k,) parameters of the plant, then those of effects as a diagnosis names them. "NAME [2]" is the second
        starting point of an effect whose place or level is unknown.
    nominal: number of parameters of the plant, which come first.
    scale: (k,) SI value of one unit of x.
    score, information: (k,), (k, k), as for white residuals.
    dispersion: variance of the scores over that of white residuals, at least 1.
    causes: as a diagnosis names them -> their names.
    start: date of the first sample [s since 1970, UTC], None for a log without dates.
    rms: of the residuals at the nominal plant and after the Gauss-Newton steps, in assumed standard deviations.
    """

    names: tuple[str, ...]
    nominal: int
    scale: np.ndarray
    score: np.ndarray
    information: np.ndarray
    dispersion: float
    causes: Mapping[str, tuple[str, ...]]
    rms: tuple[float, float]
    start: float | None = None


@dataclass(frozen=True)
class _Direction:
    """A direction of x: from the setting `base` to `moved` is `size` units of x, one unit is `scale` in SI."""

    name: str
    scale: float
    base: Mapping[str, float]
    moved: Mapping[str, float]
    size: float


@one_blas_thread()
def log_score(plant: Plant, log: Log, *, check: bool = True) -> LogScore:
    """Score and information of a log, for the plant's parameters and all effects of the catalogue that can act.

    Parameters
    ----------
    plant: nominal, with the load of the log. log: of at least 3 s. check: as for `diagnose`.

    Raises InputError as `diagnose`.
    """
    prepared = prepare_logs(plant, [log], None, 0.03, check=check)
    whole = Segment((prepared.logs[0].record,), log.name)
    linearisation = _Linearisation(windows_of([prepared.logs[0].plant], whole) or whole)
    nominal = linearisation.nominal_directions()
    (before,) = linearisation.residuals([{}])
    if before is None:
        raise InputError(
            f"{log.path or 'the log'}: the nominal plant can't be simulated with this log's "
            f"{plant.structure.system.drive}; check the plant's parameters, and the log's units and signs"
        )
    at, after, nominal = linearisation.refit(nominal, before)
    steps = {one.name: (at.get(one.name, one.base[one.name]) - one.base[one.name]) / one.scale for one in nominal}
    directions, causes = _with_effects(nominal, segment_candidates(whole), at)
    shown, blocks = linearisation.at(at, after, directions)
    score, information = _sums(blocks)
    names = tuple(one.name for one in shown)
    there = {label: tuple(name for name in listed if name in names) for label, listed in causes.items()}
    return LogScore(
        names=names,
        nominal=sum(name in steps for name in names),
        scale=np.array([one.scale for one in shown]),
        score=score + information @ np.array([steps.get(name, 0.0) for name in names]),
        information=information,
        dispersion=_dispersion(blocks),
        causes={label: listed for label, listed in there.items() if listed},
        rms=(_rms(before), _rms(after)),
        start=None if log.start is None else log.start + float(log.time[0]),
    )


class _Linearisation:
    """Residuals of a log in windows, and their derivatives with the start of each window eliminated."""

    def __init__(self, windows: Segment) -> None:
        self.records, self.plant = windows.records, windows.model.plant
        self.scale = ResidualScale.of_records(windows.records)
        self.own = windows.own_parameters

    def residuals(
        self, settings: Sequence[Mapping[str, float]], records: Sequence[Record] | None = None
    ) -> list[Residuals | None]:
        """Residuals of each setting; None if a run stopped."""
        records = records or self.records
        channels = len(self.scale.scale)
        return [
            None
            if runs is None
            else [
                self.scale.residual_of([one], (run,)).reshape(channels, -1)
                for one, run in zip(records, runs, strict=True)
            ]
            for runs in run_records(records, settings)
        ]

    def nominal_directions(self) -> list[_Direction]:
        """Parameters that a diagnosis refits; their unit is the standard deviation of a typical nominal value."""
        found = []
        needed = needed_to_simulate(self.plant.structure.equations)
        for kind in self.plant.structure.equations.parameters:
            value = self.plant[kind.name]
            if kind.searched and kind.prior is not None and kind.name in needed and value and kind.name not in self.own:
                moved = {kind.name: value * (1.0 + STEP)}
                found.append(
                    _Direction(kind.name, kind.prior * abs(value), {kind.name: value}, moved, STEP / kind.prior)
                )
        return found

    def refit(
        self, directions: Sequence[_Direction], here: Residuals
    ) -> tuple[dict[str, float], Residuals, list[_Direction]]:
        """Gauss-Newton steps from the nominal plant: setting, residuals there, and the directions that the log shows.

        With priors of one unit, and only as long as the residuals become smaller. here: residuals at the nominal plant.
        """
        x = np.zeros(len(directions))
        at: dict[str, float] = {}
        for _ in range(STEPS):
            there = [_at(one, at) for one in directions]
            shown, blocks = self.at(at, here, there)
            directions = [one for one in directions if one.name in {s.name for s in shown}]
            x = np.array(
                [(at.get(one.name, one.base[one.name]) - one.base[one.name]) / one.scale for one in directions]
            )
            score, information = _sums(blocks)
            dispersion = _dispersion(blocks)
            step = np.linalg.solve(information / dispersion + np.eye(x.size), score / dispersion - x)
            x = np.clip(x + step, -LONGEST_STEP, LONGEST_STEP)
            values = zip(directions, x.tolist(), strict=True)
            trial = {one.name: one.base[one.name] + value * one.scale for one, value in values}
            (found,) = self.residuals([trial])
            if found is None or _rms(found) > _rms(here):
                break
            at, here = trial, found
        return at, here, list(directions)

    def at(
        self, at: Mapping[str, float], here: Residuals, directions: Sequence[_Direction]
    ) -> tuple[list[_Direction], list[np.ndarray]]:
        """The directions that the log shows, and blocks (samples, 1 + k): residuals, then their derivatives.

        here: residuals at the setting `at`.
        """
        bases = list(
            {tuple(sorted(one.base.items())): one.base for one in directions if not self._same(one.base, at)}.values()
        )
        runs = self.residuals([*({**at, **one.moved} for one in directions), *({**at, **base} for base in bases)])
        based = {tuple(sorted(base.items())): run for base, run in zip(bases, runs[len(directions) :], strict=True)}
        shown, columns = [], []
        for one, run in zip(directions, runs[: len(directions)], strict=True):
            base = here if self._same(one.base, at) else based[tuple(sorted(one.base.items()))]
            if run is not None and base is not None:
                shown.append(one)
                columns.append([(moved - other) / one.size for moved, other in zip(run, base, strict=True)])
        full = [np.stack([r, *parts], axis=2) for r, *parts in zip(here, *columns, strict=True)]
        reduced = [_without(block, start) for block, start in zip(full, self._start_derivatives(at, here), strict=True)]
        before, left = (sum(np.sum(b[..., 1:] ** 2, axis=(0, 1)) for b in blocks) for blocks in (full, reduced))
        seen = np.flatnonzero((left > LEAST_SHARE * before) & (left > 0.0))
        return [shown[i] for i in seen], _cut(
            [block[..., np.append(0, 1 + seen)] for block in reduced], self.records[0].model.log.sample_time
        )

    def _same(self, base: Mapping[str, float], at: Mapping[str, float]) -> bool:
        """Whether a direction begins at the setting `at`."""
        nominal = self.records[0].model.nominal_value
        return all(value == at.get(name, nominal(name)) for name, value in base.items())

    def _start_derivatives(self, at: Mapping[str, float], here: Residuals) -> list[np.ndarray]:
        """(channels, samples, shifts) of each window, by pressure level and position at its start.

        Both integrate, so that the error of their measured value lasts for the window.
        """
        system, columns = self.plant.structure.system, []
        groups = {"pressure": system.pressures, "position": tuple(system.positions.values())}
        for kind, states in groups.items():
            moved = []
            for record in self.records:
                start = record.model.start
                shift = START_SHIFTS[kind] if start is not None and all(state in start for state in states) else 0.0
                if start is not None and shift:
                    shifted = {**start, **{state: start[state] + shift for state in states}}
                    record = _from(record, shifted)
                moved.append(record)
            (run,) = self.residuals([at], moved)
            if run is not None and states:
                columns.append([one - other for one, other in zip(run, here, strict=True)])
        if not columns:
            return [np.zeros((*r.shape, 0)) for r in here]
        return [np.stack(parts, axis=2) for parts in zip(*columns, strict=True)]


def _from(record: Record, start: Mapping[str, float]) -> Record:
    return replace(record, model=replace(record.model, start=start))


def _without(block: np.ndarray, nuisance: np.ndarray) -> np.ndarray:
    """A block (channels, samples, 1 + k) minus its projection onto the nuisance (channels, samples, q)."""
    flat = nuisance.reshape(-1, nuisance.shape[2])
    size = np.linalg.norm(flat, axis=0)
    flat = flat[:, size > 0.0] / size[size > 0.0]
    if not flat.size:
        return block
    u, s, _ = np.linalg.svd(flat, full_matrices=False)
    u = u[:, s > 1e-6 * s[0]]
    rows = block.reshape(-1, block.shape[2])
    return np.asarray((rows - u @ (u.T @ rows)).reshape(block.shape))


def _cut(blocks: Sequence[np.ndarray], sample_time: float) -> list[np.ndarray]:
    """Blocks (channels, samples, c) cut to about BLOCK and flattened (channels samples, c)."""
    found = []
    for block in blocks:
        # Every second sample is used.
        count = max(int(round(block.shape[1] * 2.0 * sample_time / BLOCK)), 1)
        found += [part.reshape(-1, block.shape[2]) for part in np.array_split(block, count, axis=1)]
    return found


def _sums(blocks: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Score (k,) and information (k, k)."""
    products = sum(block.T @ block for block in blocks)
    return -np.asarray(products)[1:, 0], np.asarray(products)[1:, 1:]


def _dispersion(blocks: Sequence[np.ndarray]) -> float:
    """Variance of the scores between blocks over that of white residuals; mean over the parameters, at least 1.

    At the values that fit the log best among these parameters, in the directions that the log determines. The variance
    between blocks is White's; H. White, "A heteroskedasticity-consistent covariance matrix estimator and a direct test
    for heteroskedasticity", Econometrica 48 (1980).
    """
    score, information = _sums(blocks)
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    # More directions than blocks would be fitted to the scores of single blocks.
    best = np.argsort(-values)[: max(len(blocks) // 2, 1)]
    along = vectors[:, best] / size[:, None] / np.sqrt(values[best])
    x = along @ (along.T @ score)
    scores = np.array([-(block[:, 1:] @ along).T @ (block[:, 0] + block[:, 1:] @ x) for block in blocks])
    freedom = len(blocks) / max(len(blocks) - 1, 1)
    return max(float(freedom * np.mean(np.sum(scores**2, axis=0))), 1.0)


def _rms(residuals: Residuals) -> float:
    squares = sum(float(np.sum(one**2)) for one in residuals)
    return float(np.sqrt(squares / sum(one.size for one in residuals)))


def _at(direction: _Direction, at: Mapping[str, float]) -> _Direction:
    """A direction of one parameter, from the setting `at`."""
    name = direction.name
    value = at.get(name, direction.base[name])
    return replace(direction, base={name: value}, moved={name: value + direction.size * direction.scale})


def _with_effects(
    nominal: Sequence[_Direction], candidates: Sequence[CandidateEffect], at: Mapping[str, float]
) -> tuple[list[_Direction], dict[str, list[str]]]:
    """Directions of the plant's parameters and of effects from the setting `at`, and the names of each cause.

    Of the forms of an effect, each that begins with another number counts.
    """
    found = {one.name: _at(one, at) for one in nominal}
    causes: dict[str, list[str]] = {}
    first: set[tuple[str, str | None, str]] = set()
    for candidate in candidates:
        form = (*candidate.key, candidate.names[0])
        if form in first:
            continue
        first.add(form)
        listed = causes.setdefault(name_of(candidate.key), [])
        for direction in _effect_directions(candidate, at):
            if direction.name not in listed:
                listed.append(direction.name)
            found.setdefault(direction.name, direction)
    return list(found.values()), causes


def _effect_directions(candidate: CandidateEffect, at: Mapping[str, float]) -> list[_Direction]:
    """Directions of an effect: secants as long as to its starting point.

    From the effect's absence to each starting point as a whole where place, shape or level is unknown; one unit is
    then the first number's scale, or all of the effect where that number is infinite without it.
    """
    first = candidate.free[0]
    finite = np.isfinite(first.nominal)
    if candidate.shaped or not finite:
        found = []
        for number, start in enumerate(candidate.starts[:MOST_STARTS], 1):
            values = dict(zip(candidate.names, start, strict=True))
            scale = first.scale if finite else 1.0
            size = (start[0] - first.nominal) / scale if finite else 1.0
            if size:
                name = first.name if number == 1 else f"{first.name} [{number}]"
                found.append(_Direction(name, scale, {}, values, size))
        return found
    moved = []
    fixed = {f.name: f.nominal for f in candidate.free if f.fixed}
    for free, begin in zip(candidate.free, candidate.starts[0], strict=True):
        if free.fixed:
            continue
        value = float(at.get(free.name, free.nominal))
        step = max(begin - free.nominal, 0.0) or free.scale
        base = {free.name: value}
        moved.append(_Direction(free.name, free.scale, base, {**fixed, free.name: value + step}, step / free.scale))
    return moved
