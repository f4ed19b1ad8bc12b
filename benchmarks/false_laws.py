"""Laws that the search finds where there is none: in logs without a gap, and for placebos of an unknown input.

python benchmarks/withheld/cases.py --set reported --family none --count 300 --out results/withheld/no_gap
python benchmarks/false_laws.py verdicts results/withheld/no_gap
python benchmarks/false_laws.py forced results/withheld/no_gap --count 60 --seconds 10
python benchmarks/withheld/cases.py --set tuning --family outside --count 15 --out results/withheld/outside
python benchmarks/false_laws.py placebo results/withheld/outside --count 10 --seconds 12

`verdicts` diagnoses logs as `ehsa-ctrl diagnose` does. `forced` searches a law although there is no gap, where an
effect below the threshold may be found. `placebo` replaces each unknown input by itself reversed in time, and by a
signal of the same spectrum with random phases. What a placebo's law closes of the gap on held-out data, simulated as it
was found, is shown beside what the law of the unknown input closes. Cases come in random order, so that a part is a
sample.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.core.parallel import one_blas_thread
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses, Task
from ehsa_ctrl.diagnosis.law.find import LawBase, find_law
from ehsa_ctrl.diagnosis.law.free_run import gap_as_found, screen_laws
from ehsa_ctrl.diagnosis.law.inputs import LawInput
from ehsa_ctrl.diagnosis.law.regression import find_sums
from ehsa_ctrl.diagnosis.model_selection import Reference
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.prepared_logs import curve_logs, prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.regimes import Windows
from ehsa_ctrl.diagnosis.scoring import Scoring
from ehsa_ctrl.diagnosis.signals import largest
from ehsa_ctrl.plant.plant import Plant

THRESHOLD = 0.03
#: Largest share of the gap that a placebo may close.
ALLOWED = 0.02


@dataclass(frozen=True)
class Search:
    """What a law search needs, for the nominal plant alone."""

    base: LawBase
    scoring: Scoring
    pool: Pool

    @classmethod
    def of(cls, plant: Plant, log: Log) -> Search:
        prepared = prepare_logs(plant, [log], None, THRESHOLD, check=True)
        segments = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=False)
        pool = Pool(1, None)
        objective, sensitivities = objective_of(segments.training, THRESHOLD)
        start = Hypotheses.initial(objective, (), sensitivities, pool)
        start = start.with_refits([Task((), {})], "nominal parameters", steps=6)
        start = start.with_level_of(start.best()[0])
        scoring = Scoring.of(start, segments.training, segments.held_out, THRESHOLD, lumped=False)
        return cls(LawBase(curve_logs(prepared, segments, prepared.plant), start.fits[()]), scoring, pool)

    def law(self) -> str:
        """The form of the law that the search accepts; empty without one."""
        found = find_law([self.base], self.scoring, Reference.of(self.scoring), self.pool)
        return "" if found is None else f"{found.proposed.place}: {found.proposed.forms[0].file.form}"

    def closed(self, inputs: Sequence[LawInput]) -> float:
        """Share of the held-out gap that the law closes which leaves least on the training data, as it was found."""
        laws = [law for one in inputs for law in find_sums(one.grammar, one.windows, one.nuisance)]
        ranked = screen_laws(laws, self.scoring, self.base.fit, self.pool)
        if not ranked:
            return 0.0
        nominal = self.scoring.held_out.gap({})["total"]
        return 1.0 - gap_as_found(ranked[0], self.scoring, self.base.fit, held_out=True) / nominal


def with_values(windows: Windows, values: np.ndarray) -> Windows:
    """The same windows with other means."""
    other = copy(windows)
    other.values = values
    return other


def shuffled(values: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(n,) with the same spectrum and random phases."""
    spectrum = np.fft.rfft(values)
    phases = np.exp(2j * np.pi * random.random(spectrum.size))
    phases[0] = 1.0
    return np.asarray(np.fft.irfft(spectrum * phases, values.size))


def read(folder: Path, name: str, seconds: float) -> tuple[Plant, Log]:
    """Nominal plant and log of a case, the first seconds of it."""
    asked = json.loads((folder / f"{name}.json").read_text())
    settings = {f"{key}": float(value) for key, value in asked["set"].items()}
    if asked["spring_stiffness"]:
        settings["load.stiffness"] = asked["spring_stiffness"]
    plant = ehsa_ctrl.load_plant(asked["plant"], model=asked["model"], settings=settings)
    log = ehsa_ctrl.read_plant_log(folder / asked["log"], plant)
    return plant, log.segment(None, log.time[0] + seconds) if seconds else log


def verdicts(folder: Path, names: Sequence[str], seconds: float) -> None:
    """Print how many of the logs get which verdict, and which get a law."""
    found = {name: ehsa_ctrl.diagnose(*read(folder, name, seconds), jobs=1) for name in names}
    print(f"{len(found)} logs: {dict(Counter(one.verdict for one in found.values()))}")
    print(f"laws: {[name for name, one in found.items() if one.law is not None] or 'none'}")


def forced(folder: Path, names: Sequence[str], seconds: float) -> None:
    """Print the law that the search accepts in each log."""
    counts = {True: [0, 0], False: [0, 0]}
    for i, name in enumerate(names, 1):
        law = Search.of(*read(folder, name, seconds)).law()
        small = json.loads((folder / "keys" / f"{name}.json").read_text())["below_threshold"]
        counts[bool(small)][0] += 1
        counts[bool(small)][1] += bool(law)
        there = ", ".join(f"{one['id']} ({one['law']})" for one in small) or "nothing"
        print(f"{i} {name}: law: {law or 'none'}; there is: {there}; {time.process_time():.0f} s", flush=True)
        for acts, (logs, laws) in counts.items():
            words = "an effect below the threshold" if acts else "parameter errors alone"
            print(f"   {words}: {logs} logs, {laws} laws", flush=True)


def placebo(folder: Path, names: Sequence[str], seconds: float) -> None:
    """Print what the laws of placebos close of the gap."""
    random, rows = np.random.default_rng(0), []
    print("| case | the unknown input | reversed in time | random phases |\n|---|---|---|---|")
    for name in names:
        plant, log = read(folder, name, seconds)
        search = Search.of(plant, log)
        if largest(search.scoring.training.gap({})) < THRESHOLD:
            continue
        inputs = search.base.inputs(search.scoring.objective.nominal)
        made: Mapping[str, list[Windows]] = {
            "itself": [one.windows for one in inputs],
            "reversed": [one.windows.reversed() for one in inputs],
            "shuffled": [with_values(one.windows, shuffled(one.windows.values, random)) for one in inputs],
        }
        row = []
        for windows in made.values():
            other = [LawInput(one.grammar, w, one.nuisance) for one, w in zip(inputs, windows, strict=True)]
            row.append(search.closed(other))
        rows.append(row)
        print(f"| {name} | " + " | ".join(f"{share:.3f}" for share in row) + " |", flush=True)
    within = [max(row[1:]) <= ALLOWED for row in rows]
    print(f"\nplacebos close at most {100 * ALLOWED:.0f} %: {sum(within)} of {len(within)}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Count the laws that the search finds where there is none.")
    parser.add_argument("what", choices=[one.__name__ for one in (verdicts, forced, placebo)])
    parser.add_argument("cases", type=Path, help="folder of withheld/cases.py")
    parser.add_argument("--skip", type=int, default=0, help="first cases to leave out, after an interruption")
    parser.add_argument("--count", type=int, help="cases; all by default")
    parser.add_argument("--seconds", type=float, default=0.0, help="length of the logs [s]; all of it by default")
    options = parser.parse_args()
    names = sorted(file.stem for file in (options.cases / "keys").glob("*.json"))
    np.random.default_rng(1).shuffle(names)
    work = {one.__name__: one for one in (verdicts, forced, placebo)}[options.what]
    with one_blas_thread():
        work(options.cases, names[options.skip :][: options.count], options.seconds)


if __name__ == "__main__":
    main()
