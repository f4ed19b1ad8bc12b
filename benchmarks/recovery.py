"""One identification of a known plant, and many in parallel with results appended to a file."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed, parallel_config

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.identification.identify import identify
from ehsa_ctrl.plant.plant import Plant

DT = 0.004  # s, 250 Hz
#: Start values are the truth times one of these.
OFF = (0.7, 1.3)
#: Held-out logs: excitation, amplitude [A], duration [s]; with other noise seeds.
HELD_OUT = (("steps", 1.5, 10.0), ("sine", 1.5, 10.0))
#: Folders of the package that an estimate depends on.
FOLDERS = ("core", "physics", "plant", "simulation", "identification")


@dataclass(frozen=True)
class Case:
    """A bench log of the plant "ehsa" and the start of the search; the seed draws input, noise and start values."""

    kind: str
    amplitude: float
    duration: float
    seed: int


def truth() -> Plant:
    return ehsa_ctrl.load_plant("ehsa")


def bench_log(kind: str, amplitude: float, duration: float, seed: int) -> Log:
    """Bench log of the true plant: noise on every channel including the current, with the centring loop."""
    t, current = ehsa_ctrl.excitation(kind, amplitude=amplitude, duration=duration, sample_time=DT, seed=seed)
    log, run = ehsa_ctrl.record(truth(), t, current, seed=seed, centre=True)
    if run.stopped:
        raise RuntimeError(f"{kind} of {amplitude} A, seed {seed}: {run.stopped}")
    return log


def start_plant(seed: int) -> Plant:
    """Every free parameter 30 % too small or 30 % too large."""
    plant, draw = truth(), np.random.default_rng([seed, 30])
    return plant.set(**{name: plant[name] * float(draw.choice(OFF)) for name in plant.free})


def recover(case: Case) -> dict[str, Any]:
    """Identify one case; a row of the file, plain numbers only."""
    plant = truth()
    log = bench_log(case.kind, case.amplitude, case.duration, case.seed)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        found = identify(start_plant(case.seed), log)
    except ehsa_ctrl.EhsaError as error:
        return {"failure": str(error)}
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    held_out = {}
    for kind, amplitude, duration in HELD_OUT:
        other = bench_log(kind, amplitude, duration, 100_000 + case.seed)
        best, mine = (ehsa_ctrl.replay(p, other).fit_percent for p in (plant, found.plant))
        held_out[kind] = {channel: [best[channel], mine[channel]] for channel in best}
    return {
        "parameters": {
            e.name: {
                "truth": plant[e.name], "start": e.start, "value": e.value, "sd": e.sd, "interval": list(e.interval),
                "identifiable": e.identifiable,
            }
            for e in found.estimates
        },
        "reduced_cost": found.fit.reduced_cost, "noise_ratio": found.noise_ratio, "explained": found.explained,
        "settled": found.starts_agree, "sd_from": found.uncertainty.source,
        "tried": [name for name, _ in found.starts], "held_out": held_out, "wall": wall, "cpu": cpu,
    }  # fmt: skip


def fingerprint() -> str:
    """Hash of all sources of an estimate, so that results of an older package are not reused."""
    package = Path(ehsa_ctrl.__file__).parent
    files = [file for folder in FOLDERS for file in (package / folder).rglob("*") if file.suffix in (".py", ".j2")]
    files += [ehsa_ctrl.plants["ehsa"], Path(__file__)]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()[:12]


def read_results(file: Path, package: str) -> dict[Case, dict[str, Any]]:
    """Results of earlier runs with this package; truncated lines are ignored."""
    found = {}
    for line in file.read_text().splitlines() if file.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row.get("package") == package:
            found[Case(**row["case"])] = row["result"]
    return found


def recover_all(cases: list[Case], file: Path, jobs: int) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Results in order of completion, those from `file` first; new ones are appended to it."""
    package = fingerprint()
    known = read_results(file, package)
    for case in cases:
        if case in known:
            yield case, known[case]
    left = [case for case in cases if case not in known]
    if not left:
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a") as lines, parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        for case, result in Parallel(return_as="generator_unordered")(delayed(_pair)(case) for case in left):
            lines.write(json.dumps({"package": package, "case": asdict(case), "result": result}) + "\n")
            lines.flush()
            yield case, result


def _pair(case: Case) -> tuple[Case, dict[str, Any]]:
    return case, recover(case)
