"""Fleets: false discoveries among rigs that have not changed, and logs per core hour.

    ehsa-ctrl fleet --virtual 200 --seed 1 --out results/virtual --jobs -1
    python benchmarks/fleet.py results/virtual [--repeats 100] [--rigs 24 --days 3] [--logs 20]
        [--copies 10 [--one-rig]]

From the store of a virtual fleet, whose truth is known. Rigs without a change are drawn anew, the order of each one's
logs at random, so that nothing can have changed in time while everything else is as the simulation made it: sensor
noise, excitations that differ, and what the linearisation leaves. The changed rigs are left out (complete null) or
kept as they are; drifts and rigs unlike the fleet are tested on the complete null. Then the throughput of the per-log
statistic, as processor time of one core; and with --copies, time and memory of the analysis of a fleet so many times as
large, whose rigs are copies, or with --one-rig of a single rig that has all these logs.

Figures of docs/evidence.md: seeds from 1 on; tuning used 101.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from datetime import UTC, datetime, timedelta
from itertools import count, groupby
from pathlib import Path

import numpy as np

import ehsa_ctrl as e
from ehsa_ctrl.core.files import read_json
from ehsa_ctrl.core.result import to_json
from ehsa_ctrl.fleet.analyse import analyse_fleet
from ehsa_ctrl.fleet.changes import ChangeTest, Names, RigScores, Scan, scan
from ehsa_ctrl.fleet.drifts import drifts
from ehsa_ctrl.fleet.manifest import FleetLog, find_logs
from ehsa_ctrl.fleet.null import false_discovery_rates, scatter
from ehsa_ctrl.fleet.outliers import outliers
from ehsa_ctrl.fleet.random_effects import random_effects
from ehsa_ctrl.fleet.score import log_score
from ehsa_ctrl.fleet.store import Store
from ehsa_ctrl.fleet.virtual import LOGS, TRUTH

RATE, DAY = 0.05, 86400.0
#: Date of the first log of a single rig.
FIRST = datetime(2020, 1, 1, tzinfo=UTC)


def rigs_of(folder: Path, plant: e.Plant) -> tuple[list[RigScores], Names, set[str]]:
    """The rigs of a virtual fleet whose logs all have a score, and the names of those that change."""
    store = Store(folder, plant)
    changed = set(read_json(folder / TRUTH)["changed"])
    found = {}
    for rig, logs in groupby(find_logs([folder / LOGS]), lambda log: log.rig):
        listed = list(logs)
        keys = [store.key(log.path) for log in listed]
        if all(store.part(key).exists() for key in keys):
            found[rig] = ([log.date.timestamp() / 86400.0 for log in listed], [store.get(key) for key in keys])
    names = Names.of(score for _, scores in found.values() for score in scores)
    return [names.rig(rig, days, scores) for rig, (days, scores) in found.items()], names, changed


def shuffled(rig: RigScores, random: np.random.Generator) -> RigScores:
    """The rig with its logs in random order."""
    order = random.permutation(len(rig.days))
    return RigScores(rig.name, rig.days, rig.score[order], np.asarray(rig.information)[order])


def taken(rig: RigScores, days: int | None, random: np.random.Generator) -> RigScores:
    """The rig with so many of its logs, in random order."""
    one = shuffled(rig, random)
    return one if days is None else one.part(0, days)


def others(rigs: list[RigScores], names: Names, plant: e.Plant) -> tuple[int, int]:
    """Number of rigs that are said to drift, and to be unlike their fleet."""
    n = names.nominal
    moved = [scan(rig, names.of_parameters()) for rig in rigs]
    between = scatter([one.statistic for one in moved if one.times])
    fleet = random_effects(
        np.array([rig.score[:, :n].sum(axis=0) for rig in rigs]) / between,
        np.array([rig.total[:n, :n] for rig in rigs]) / between,
    )
    unlike = false_discovery_rates([1.0 if one is None else one.p for one in outliers(rigs, names, fleet)])
    logs = {rig.name: [FleetLog(Path(), rig.name, datetime.fromtimestamp(DAY * d, UTC), "name") for d in rig.days]
            for rig in rigs}  # fmt: skip
    return len(drifts(moved, names, plant, RATE, logs, (), {one.rig: one for one in moved}.__getitem__)), int(
        np.sum(unlike <= RATE)
    )


def large(folder: Path, copies: int, plant: e.Plant, one_rig: bool) -> None:
    """Processor time and peak memory of the analysis of a fleet of copies: its logs are stubs, its parts links.

    one_rig: all logs are of one rig, one each hour.
    """
    store, hours = Store(folder, plant), count()
    with tempfile.TemporaryDirectory(dir=folder) as place:
        other = Store(Path(place) / "store", plant)
        other.begin()
        for log in find_logs([folder / LOGS]):
            part = store.part(store.key(log.path))
            for copy in range(copies if part.exists() else 0):
                rig, date = f"{log.rig}-{copy}", log.date
                if one_rig:
                    rig, date = "rig", FIRST + timedelta(hours=next(hours))
                stub = Path(place) / "logs" / rig / f"{date:%Y-%m-%dT%H%M}.parquet"
                stub.parent.mkdir(parents=True, exist_ok=True)
                stub.write_text(f"{log.path} {copy}")
                link = other.part(other.key(stub))
                link.parent.mkdir(parents=True, exist_ok=True)
                os.link(part, link)
        began = time.process_time()
        found = analyse_fleet(plant, Path(place) / "logs", store=other.folder, diagnose=False)
        analysed = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        size = len(to_json(found.to_dict())) / 1e6
        took = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"{found.log_count} known logs of {len(found.rigs)} rigs: {took:.0f} s of processor time, at most "
          f"{analysed:.2f} GB of memory, {peak:.2f} GB with fleet.json of {size:.0f} MB")  # fmt: skip


def discoveries(scans: list[Scan], names: Names) -> set[str]:
    """Rigs that are said to have changed."""
    test = ChangeTest.of(scans, names)
    found = [None if test is None else test.change(one) for one in scans]
    q = false_discovery_rates([1.0 if one is None else one.p for one in found])
    return {one.rig for one, value in zip(found, q, strict=True) if one is not None and value <= RATE}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("store", type=Path)
    parser.add_argument("--repeats", type=int, default=100)
    parser.add_argument("--share", type=float, default=0.8, help="of the unchanged rigs that a repeat draws")
    parser.add_argument("--logs", type=int, default=20, help="for the throughput")
    parser.add_argument("--rigs", type=int, help="that a repeat draws, instead of a share")
    parser.add_argument("--days", type=int, help="logs of each rig, instead of all")
    parser.add_argument("--copies", type=int, default=0, help="of each rig, for the analysis of a large fleet")
    parser.add_argument("--one-rig", action="store_true", help="all these copies are logs of one rig")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    plant, random = e.load_plant("ehsa"), np.random.default_rng(options.seed)

    rigs, names, changed = rigs_of(options.store, plant)
    still = [rig for rig in rigs if rig.name not in changed]
    moved = [scan(rig, names) for rig in rigs if rig.name in changed]
    print(f"{len(rigs)} rigs, {len(moved)} of them changed")
    alone: list[int] = []
    drifting: list[int] = []
    unlike: list[int] = []
    shares, missed = [], []
    for _ in range(options.repeats):
        chosen = random.choice(len(still), options.rigs or int(options.share * len(still)), replace=False)
        drawn = [taken(still[i], options.days, random) for i in chosen]
        scans = [scan(rig, names) for rig in drawn]
        alone.append(len(discoveries(scans, names)))
        for several, number in zip((drifting, unlike), others(drawn, names, plant), strict=True):
            several.append(number)
        found = discoveries([*scans, *moved], names)
        wrong = len(found - changed)
        shares.append(wrong / max(len(found), 1))
        missed.append(len(moved) - len(found & changed))
    for what, numbers in (("change", alone), ("drift", drifting), ("rig unlike its fleet", unlike)):
        print(f"nothing changed, {len(drawn)} rigs: {sum(n > 0 for n in numbers)} of {options.repeats} fleets with a "
              f"false {what} (at most {100 * RATE:g} % wanted)")  # fmt: skip
    print(f"{len(moved)} rigs changed: mean share of false discoveries {100 * np.mean(shares):.2f} %, "
          f"{np.mean(missed):.2f} changed rigs missed on average, {max(missed)} at most")  # fmt: skip

    if options.copies:
        large(options.store, options.copies, plant, options.one_rig)
    logs = find_logs([options.store / LOGS])[: options.logs + 1]
    log_score(plant, e.read_plant_log(logs[0].path, plant))  # compiled now
    began = time.process_time()
    for log in logs[1:]:
        log_score(plant, e.read_plant_log(log.path, plant))
    seconds = (time.process_time() - began) / len(logs[1:])
    print(f"{seconds:.2f} s of processor time a log of 8 to 9 s: {3600 / seconds:.0f} logs per core hour; "
          f"100 000 logs: {1e5 * seconds / 3600:.0f} core hours")  # fmt: skip


if __name__ == "__main__":
    main()
