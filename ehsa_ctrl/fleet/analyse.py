"""The logs of a fleet from files to the result: scores into the store, then the statistics of the whole fleet."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import EhsaError, InputError
from ..core.parallel import as_completed, worker_count
from ..diagnosis.diagnosis import Diagnosis
from ..identification.plant_log import read_plant_log
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from .changes import ChangeTest, Names, RigChange, RigScores, scan
from .drifts import drifts
from .manifest import FILE_TIME, FleetLog, find_logs, in_order
from .null import false_discovery_rates, scatter
from .outliers import outliers
from .random_effects import RandomEffects, random_effects
from .result import Fleet, FleetParameter, FleetRig, FurtherChange, LogLine
from .rig_diagnosis import diagnose_changed
from .score import LogScore, log_score
from .store import Store
from .tables import write_tables

#: Share of a unit's worth of information over the fleet below which a parameter counts as not determined.
#: Engineering judgement.
DETERMINED = 2.0

Watch = Callable[[str, int, int], None]


@dataclass(frozen=True)
class _StoredScores(Sequence[LogScore]):
    """Scores that are read from a store each time that they are asked for."""

    store: Store
    keys: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, i: Any) -> Any:
        return self.store.get(self.keys[i])


@dataclass(frozen=True)
class _Rig:
    """A rig with its logs and the keys of their parts."""

    name: str
    logs: tuple[FleetLog, ...]
    keys: tuple[str, ...]

    def scores(self, store: Store) -> _StoredScores:
        return _StoredScores(store, self.keys)

    @property
    def days(self) -> list[float]:
        return [log.date.timestamp() / 86400.0 for log in self.logs]


def analyse_fleet(
    plant: Plant,
    logs: str | Path | Sequence[str | Path],
    *,
    store: str | Path,
    by: str = "",
    rate: float = 0.05,
    diagnose: bool = True,
    check: bool = True,
    jobs: int | None = None,
    watch: Watch | None = None,
    truth: Mapping[str, Mapping[str, str]] | None = None,
    keep: Callable[[str, Diagnosis], None] | None = None,
) -> Fleet:
    """Which rigs of a fleet changed, in what and since when; its parameters and their spread.

    Each log that the store does not know yet is simulated some hundred times, which takes about a second; then the
    store alone is read. After an interruption, the same call continues.

    Parameters
    ----------
    plant: the nominal plant of all rigs.
    logs: files, folders and manifests, see `find_logs`; by as there.
    store: folder of the store, see `Store`.
    rate: false-discovery rate of the changed rigs.
    diagnose: diagnose the first log after each change in full.
    check: as for `diagnose`.
    jobs: number of workers, -1 for all cores; by default that of joblib's context (`joblib.parallel_config`, also with
        the backend "dask"), else 1.
    watch: progress callback, called with the stage, and the number of finished and of all items.
    truth: of a virtual fleet, see `Fleet`.
    keep: called with each new diagnosis, after the folder for it, relative to the store.

    Raises
    ------
    InputError: as `find_logs` and `Store`; no log could be used; a part is damaged; rate is not between 0 and 1.
    """
    if not 0.0 < rate < 1.0:
        raise InputError(f"rate = {rate:g}; expected a false-discovery rate between 0 and 1, such as 0.05")
    found = find_logs([logs] if isinstance(logs, str | Path) else logs, by)
    into = Store(store, plant)
    into.begin()
    keys, failed, computed, notes = _fill(into, plant, found, check, jobs, watch)
    used = in_order(
        log if log.dated != FILE_TIME else log.stamped(into.get(keys[log.path]).start)
        for log in found if log.path in keys
    )  # fmt: skip
    by_rig = {name: tuple(logs) for name, logs in groupby(used, lambda log: log.rig)}
    rigs = [_Rig(name, logs, tuple(keys[log.path] for log in logs)) for name, logs in by_rig.items()]
    if not rigs:
        raise InputError(f"no log could be used; the first: {next(iter(failed.values()))}")
    result = _statistics(plant, into, rigs, rate, watch)
    undated = sum(log.dated == FILE_TIME for log in used)
    if undated:
        notes.append(
            f"logs with no date but the time at which the file was written: {undated}; give dates in a fleet.csv, or "
            "in the files' names"
        )
    result = replace(
        result, failed=failed, notes=(*result.notes, *notes), computed=computed, kept=len(keys) - computed,
        truth=truth or {}, store=into,
    )  # fmt: skip
    if diagnose and result.changed:
        plants = {name: plant.set(**values) for name, values in _before(plant, into, rigs, result)}
        result = diagnose_changed(result, plants, into, jobs=jobs, check=check, watch=watch, keep=keep)
    write_tables(into, result)
    return result


def _fill(
    store: Store, plant: Plant, logs: Sequence[FleetLog], check: bool, jobs: int | None, watch: Watch | None
) -> tuple[dict[Path, str], dict[str, str], int, list[str]]:
    """Compute the missing parts. Returns path -> key of the logs that can be used, path -> error of the others, the
    number that was computed, and notes.
    """
    keys: dict[Path, str] = {}
    failed: dict[str, str] = {}
    notes: list[str] = []
    first: dict[str, FleetLog] = {}
    for log in logs:
        key = store.key(log.path)
        if key in first:
            notes.append(f"{log.path}: has the content of {first[key].path}; it counts once")
            continue
        first[key] = log
        keys[log.path] = key
    todo = [(path, key) for path, key in keys.items() if not store.part(key).exists()]
    work = partial(_score, plant, check)
    done = len(keys) - len(todo)
    if watch is not None:
        watch("logs", done, len(keys))
    count = min(worker_count(jobs), max(len(todo), 1))
    with closing(as_completed(work, todo, count=count)) as results:
        for path, key, score in results:
            if isinstance(score, str):
                failed[str(path)] = score
                del keys[path]
            else:
                store.put(key, score)
            done += 1
            if watch is not None:
                watch("logs", done, len(keys) + len(failed))
    return keys, failed, len(todo) - len(failed), notes


def _score(plant: Plant, check: bool, job: tuple[Path, str]) -> tuple[Path, str, LogScore | str]:
    """Score of one log, or why there is none; runs on a worker."""
    path, key = job
    try:
        return path, key, log_score(plant, read_plant_log(path, plant), check=check)
    except EhsaError as error:
        return path, key, str(error)
    except (ArithmeticError, ValueError, LookupError) as error:
        # An unexpected failure of one log must not lose the others.
        return path, key, f"{path}: its score failed ({type(error).__name__}: {error})"


def _scores(store: Store, rigs: Sequence[_Rig], names: Names) -> Iterator[RigScores]:
    """The rigs one by one, so that a large fleet needs little memory."""
    for rig in rigs:
        yield names.rig(rig.name, rig.days, rig.scores(store))


def _statistics(plant: Plant, store: Store, rigs: Sequence[_Rig], rate: float, watch: Watch | None) -> Fleet:
    """Changes, parameters, outliers and drifts of the fleet."""

    def report(stage: str, done: int) -> None:
        if watch is not None:
            watch(stage, done, len(rigs))

    rms: dict[str, tuple[float, float]] = {}

    def read() -> Iterator[LogScore]:
        for rig in rigs:
            for key, one in zip(rig.keys, rig.scores(store), strict=True):
                rms[key] = one.rms
                yield one

    names = Names.of(read())
    n, own_names, by_name = names.nominal, names.of_parameters(), {rig.name: i for i, rig in enumerate(rigs)}
    score, information = np.zeros((len(rigs), n)), np.zeros((len(rigs), n, n))

    def add(one: RigScores) -> None:
        i = by_name[one.name]
        score[i], information[i] = one.score[:, :n].sum(axis=0), one.total[:n, :n]

    scans, moved = [], []
    for done, one in enumerate(_scores(store, rigs, names), 1):
        scans.append(scan(one, names).statistics)
        moved.append(scan(one, own_names).statistics)
        add(one)
        report("changes", done)
    test = ChangeTest.of(scans, names)
    p = [1.0 if test is None else test.p(one) for one in scans]
    q = false_discovery_rates(p)
    significant = [rig for rig, value in zip(rigs, q, strict=True) if value <= rate]
    limit = max((each for each, value in zip(p, q, strict=True) if value <= rate), default=0.0)
    changed: dict[str, list[RigChange]] = {}
    for one in _scores(store, significant, names):
        if test is not None and (change := test.change(scan(one, names))) is not None:
            changed[one.name] = (test.steps(one, limit) if change.first > 0 else []) or [change]
            add(_unchanged(one, changed[one.name]))
    # What the logs of an unchanged rig say differs by more than one log's own uncertainty.
    between_logs = scatter([one.statistic for one in moved if one.times])
    score /= between_logs
    information /= between_logs
    fleet = random_effects(score, information)
    before_change = (_unchanged(one, changed.get(one.name)) for one in _scores(store, rigs, names))
    unlike = outliers(before_change, names, fleet)
    unlike_q = false_discovery_rates([1.0 if one is None else one.p for one in unlike])
    shown = {one.cause for several in changed.values() for one in several} | {
        one.cause for one, value in zip(unlike, unlike_q, strict=True) if one is not None and value <= rate
    }
    rows = []
    for i, rig in enumerate(rigs):
        other = unlike[i]
        deviations = _series(names.rig(rig.name, rig.days, rig.scores(store)), names, fleet, i, shown)
        row = FleetRig(
            rig.name,
            tuple(
                LogLine(str(log.path), _place(log.path, store.folder), log.date.isoformat(), log.dated, rms[key])
                for log, key in zip(rig.logs, rig.keys, strict=True)
            ),
            p=p[i], q=float(q[i]), series=deviations,
        )  # fmt: skip
        if rig.name in changed:
            row = _with_changes(row, changed[rig.name], names, plant)
        if other is not None:
            row = replace(
                row, unlike=other.cause if unlike_q[i] <= rate else "", unlike_p=other.p, unlike_q=float(unlike_q[i])
            )
        rows.append(row)
        report("rigs", i + 1)
    return Fleet(
        plant.name, rate, tuple(rows), _parameters(plant, names, fleet),
        drifts(
            moved, names, plant, rate, {rig.name: rig.logs for rig in rigs},
            {name for name, several in changed.items() if several[0].first > 0},
            lambda name: scan(next(_scores(store, [rigs[by_name[name]]], names)), own_names),
        ), tuple(names.causes),
    )  # fmt: skip


def _unchanged(rig: RigScores, changes: Sequence[RigChange] | None) -> RigScores:
    """The logs of a rig before its first change: all without one, the first of a drift."""
    if not changes:
        return rig
    return rig.part(0, changes[0].first if changes[0].first > 0 else 1)


def _place(log: Path, folder: Path) -> str:
    """Path of a log seen from a folder; empty on another drive."""
    try:
        return Path(os.path.relpath(log, folder)).as_posix()
    except ValueError:
        return ""


def _with_changes(row: FleetRig, changes: Sequence[RigChange], names: Names, plant: Plant) -> FleetRig:
    """The rig with its changes, the most significant in front."""
    main = max(changes, key=lambda one: one.statistic)
    step = main.first > 0
    kind, file = ("step", row.logs[main.first].file) if step else ("drift", row.logs[-1].file)
    further = tuple(
        FurtherChange(
            one.cause, one.same, row.logs[one.first].date, row.logs[one.earliest].date, row.logs[one.latest].date,
            row.logs[one.first].file, _size(one, names, plant), one.p,
        )
        for one in changes if one is not main
    )  # fmt: skip
    return replace(
        row, changed=True, kind=kind, cause=main.cause, same=main.same, by="score", scored=main.cause, file=file,
        since=row.logs[max(main.first, 0)].date, earliest=row.logs[max(main.earliest, 0)].date,
        latest=row.logs[max(main.latest, 0)].date, size=_size(main, names, plant), further=further,
    )  # fmt: skip


def _size(change: RigChange, names: Names, plant: Plant) -> dict[str, dict[str, Any]]:
    """Parameter -> its change with standard deviation and unit, the most significant first."""
    units = _parameter_units(plant)
    size: dict[str, dict[str, Any]] = {
        names.names[i]: {"change": float(d * names.scale[i]), "sd": float(s * names.scale[i]),
                         "unit": _unit_of(names.names[i], plant, units)}
        for i, d, s in zip(change.positions, change.size, change.sd, strict=True)
    }  # fmt: skip
    return dict(sorted(size.items(), key=lambda item: -(item[1]["change"] ** 2) / item[1]["sd"] ** 2))


def _series(rig: RigScores, names: Names, fleet: RandomEffects, number: int, causes: set[str]) -> dict[str, np.ndarray]:
    """Parameter or cause -> (logs, 2) deviation from nominal and its sd, the other parameters as the rig has them."""
    n = names.nominal
    x = fleet.units[number]
    left, diagonal = rig.score.copy(), np.zeros_like(rig.score)
    for rows, block in rig.blocks():
        left[rows] -= block[:, :, :n] @ x
        diagonal[rows] = np.einsum("lii->li", block)
    of_cause = {cause: int(own[0]) for cause, own in names.causes.items() if cause in causes and own[0] >= n}
    found = {}
    for name, i in {**{names.names[i]: i for i in range(n)}, **of_cause}.items():
        known, at = diagonal[:, i], x[i] if i < n else 0.0
        values = np.full((known.size, 2), [np.nan, np.inf])
        sees = known > 0.0
        values[sees, 0] = (at + left[sees, i] / known[sees]) * names.scale[i]
        values[sees, 1] = names.scale[i] / np.sqrt(known[sees])
        found[name] = values
    return found


def _parameters(plant: Plant, names: Names, fleet: RandomEffects) -> tuple[FleetParameter, ...]:
    units = _parameter_units(plant)
    found = []
    for i in range(names.nominal):
        name, scale = names.names[i], names.scale[i]
        determined = fleet.determined[i] >= DETERMINED
        found.append(
            FleetParameter(
                name, units.get(name, ""), plant[name], plant[name] + float(fleet.mean[i] * scale),
                float(fleet.mean_sd[i] * scale), float(fleet.spread[i] * scale) if determined else None,
                float(fleet.determined[i]),
            )
        )  # fmt: skip
    return tuple(found)


def _before(plant: Plant, store: Store, rigs: Sequence[_Rig], result: Fleet) -> Iterator[tuple[str, dict[str, float]]]:
    """Each changed rig with the values of its parameters before the change, given the fleet."""
    known = {one.name: one for one in result.parameters if one.spread}
    for rig in rigs:
        row = result.rig(rig.name)
        if not row.changed:
            continue
        place = {log.file: i for i, log in enumerate(row.logs)}
        last = place[row.file] if row.kind == "step" else 1
        # From the step before on, if the rig changed more than once.
        first = max((place[one.file] for one in row.further if place[one.file] < last), default=0)
        scores = replace(rig, keys=rig.keys[first:last]).scores(store)
        names = Names.of(scores)
        one = names.rig(rig.name, rig.days[first:last], scores)
        own = [i for i, name in enumerate(names.names[: names.nominal]) if name in known]
        spread = np.array([known[names.names[i]].spread or 0.0 for i in own]) / names.scale[own]
        mean = np.array([known[names.names[i]].mean - known[names.names[i]].nominal for i in own]) / names.scale[own]
        H = one.total[np.ix_(own, own)] + np.diag(spread**-2)
        x = np.linalg.solve(H, one.score.sum(axis=0)[own] + mean / spread**2)
        deviations = {names.names[i]: float(v * names.scale[i]) for i, v in zip(own, x, strict=True)}
        yield rig.name, {name: plant[name] + value for name, value in deviations.items()}


def _parameter_units(plant: Plant) -> dict[str, str]:
    """Unit of each parameter of the plant and of effects."""
    of_effects = {p.name: p.unit for effect in EFFECTS.values() for p in effect.parameters}
    return of_effects | {name: one.unit for name, one in plant.parameters.items()}


def _unit_of(name: str, plant: Plant, units: Mapping[str, str]) -> str:
    """Unit of a name of a score; empty for a number without one. units: of parameters."""
    word, dot, channel = name.partition(".")
    unit = plant.sensors[channel].unit_of(word) if dot else units.get(name.partition(" [")[0], "")
    return "" if unit == "1" else unit
