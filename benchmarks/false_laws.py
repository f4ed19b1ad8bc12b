"""Laws that the search finds where there is none: in logs without a gap, and for placebos of an unknown input.

python benchmarks/withheld/cases.py --set reported --family none --count 300 --out results/withheld/no_gap
python benchmarks/false_laws.py verdicts results/withheld/no_gap
python benchmarks/false_laws.py forced results/withheld/no_gap --count 60 --seconds 10
python benchmarks/withheld/cases.py --set tuning --family outside --count 15 --out results/withheld/outside
python benchmarks/false_laws.py placebo results/withheld/outside --count 10 --seconds 12

`verdicts` diagnoses logs as `ehsa-ctrl diagnose` does. `forced` searches a law although there is no gap, where an
effect below the threshold may be found. `placebo` replaces each unknown input by itself reversed in time, and by a
signal of the same spectrum with random phases. The laws of a placebo are refitted in free run like any other. Of those
that keep their terms the most probable counts: what it closes on held-out data of the gap that is left without it,
nominal parameters refitted in both, beside the same of the unknown input itself, and whether a search would accept it.
With `--any`, laws count that explain no more of the input than of the same reversed, which a search drops before the
refit. Neither placebo changes the mean of an input, which is no chance: `--centred` takes it away before. Cases come in
random order, so that a part is a sample.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.core.parallel import one_blas_thread
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses, Task
from ehsa_ctrl.diagnosis.law import regression
from ehsa_ctrl.diagnosis.law.find import MOST, find_law, with_typical_priors, without_law
from ehsa_ctrl.diagnosis.law.free_run import refit_laws
from ehsa_ctrl.diagnosis.law.inputs import LawInput
from ehsa_ctrl.diagnosis.law.judgement import clearly_better
from ehsa_ctrl.diagnosis.law.promising import beyond_chance, promising
from ehsa_ctrl.diagnosis.law.sum_problem import all_terms
from ehsa_ctrl.diagnosis.law.tried import LawBase, LawData
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
class Refitted:
    """The most probable law of an unknown input after its refit.

    law: empty without one. closed: share of the held-out gap. accepted: whether a search would propose a law.
    """

    law: str
    closed: float
    accepted: bool


@dataclass(frozen=True)
class Search:
    """What a law search needs, for the nominal plant alone."""

    start: Hypotheses
    base: LawBase
    scoring: Scoring

    @classmethod
    def of(cls, plant: Plant, log: Log) -> Search:
        prepared = prepare_logs(plant, [log], None, THRESHOLD, check=True)
        segments = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=False)
        objective, sensitivities = objective_of(segments.training, THRESHOLD)
        start = Hypotheses.initial(objective, (), sensitivities, Pool())
        start = start.with_refits([Task((), {})], "nominal parameters", steps=6)
        start = start.with_level_of(start.best()[0])
        scoring = Scoring.of(start, segments.training, segments.held_out, THRESHOLD, lumped=False)
        scoring = replace(scoring, windows=segments.windows(prepared))
        return cls(start, LawBase(curve_logs(prepared, segments, prepared.plant), start.fits[()]), scoring)

    @property
    def data(self) -> LawData:
        return LawData(lambda _: self.base, self.scoring, Reference.of(self.scoring))

    def law(self) -> str:
        """The form of the law that the search accepts; empty without one."""
        found = find_law(self.start, None, self.data)
        return "" if found is None else f"{found.proposed.place}: {found.proposed.forms[0].file.form}"

    def refitted(self, inputs: Sequence[LawInput], *, any_law: bool) -> Refitted:
        """What the most probable law of these inputs closes. any_law: whether chance may explain it as well."""
        data, fit, pool = with_typical_priors(self.data), self.base.fit, self.start.pool
        scoring = data.scoring
        sums = []
        for one in inputs:
            problem = all_terms(one.grammar, one.windows, one.nuisance)
            found = regression.find_sums(problem)
            sums += found if any_law else beyond_chance(found, regression.placebo(problem))
        laws = refit_laws(promising(sums, scoring, fit, MOST, np.inf, pool), scoring, fit, pool)
        stable = [law for law in laws if law.stable]
        if not stable:
            return Refitted("", 0.0, accepted=False)
        without = without_law(fit, scoring)
        best = min(stable, key=lambda law: law.scored.deviance)
        closed = 1.0 - best.scored.held_out_gap["total"] / without.held_out_gap["total"]
        accepted = any(
            clearly_better(law.scored, without, data.reference, by_windows_alone=law.law.is_wave) for law in stable
        )
        return Refitted(f"{best.file.adds_to}: {best.file.form}", closed, accepted)


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


def placebo(folder: Path, names: Sequence[str], seconds: float, *, any_law: bool, centred: bool) -> None:
    """Print what the laws of placebos close of the gap after their refit."""
    random, rows = np.random.default_rng(0), []
    print("| case | the unknown input | reversed in time | random phases | s |\n|---|---|---|---|---|")
    for name in names:
        plant, log = read(folder, name, seconds)
        search = Search.of(plant, log)
        if largest(search.scoring.training.gap({})) < THRESHOLD:
            continue
        inputs = search.base.inputs(search.scoring.objective.nominal)
        means = [float(np.mean(one.windows.values)) if centred else 0.0 for one in inputs]
        base = [with_values(one.windows, one.windows.values - mean) for one, mean in zip(inputs, means, strict=True)]
        made: Mapping[str, list[Windows]] = {
            "itself": [one.windows for one in inputs],
            "reversed": [one.reversed() for one in base],
            "shuffled": [with_values(one, shuffled(one.values, random)) for one in base],
        }
        row = []
        for windows in made.values():
            other = [LawInput(one.grammar, w, one.nuisance) for one, w in zip(inputs, windows, strict=True)]
            row.append(search.refitted(other, any_law=any_law))
        rows.append(row)
        words = [f"{one.closed:.3f}{', accepted' if one.accepted else ''} `{one.law}`" for one in row]
        print(f"| {name} | {' | '.join(words)} | {time.process_time():.0f} |", flush=True)
        placebos = [one for done in rows for one in done[1:]]
        within, accepted = sum(one.closed <= ALLOWED for one in placebos), sum(one.accepted for one in placebos)
        print(
            f"   placebos: {len(placebos)}; close at most {100 * ALLOWED:.0f} %: {within}; accepted: {accepted}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="Count the laws that the search finds where there is none.")
    parser.add_argument("what", choices=["verdicts", "forced", "placebo"])
    parser.add_argument("cases", type=Path, help="folder of withheld/cases.py")
    parser.add_argument("--skip", type=int, default=0, help="first cases to leave out, after an interruption")
    parser.add_argument("--count", type=int, help="cases; all by default")
    parser.add_argument("--seconds", type=float, default=0.0, help="length of the logs [s]; all of it by default")
    parser.add_argument("--centred", action="store_true", help="placebos: of the inputs without their means")
    parser.add_argument("--any", action="store_true", help="placebos: also laws that chance explains as well")
    options = parser.parse_args()
    names = sorted(file.stem for file in (options.cases / "keys").glob("*.json"))
    np.random.default_rng(1).shuffle(names)
    chosen = names[options.skip :][: options.count]
    with one_blas_thread():
        if options.what == "placebo":
            placebo(options.cases, chosen, options.seconds, any_law=options.any, centred=options.centred)
        else:
            {"verdicts": verdicts, "forced": forced}[options.what](options.cases, chosen, options.seconds)


if __name__ == "__main__":
    main()
