"""Why a cause was missed or a wrong one named: the true set of causes beside that of the answer.

Both sets are fitted to the training data as in a diagnosis, the true one from its true sizes, and scored on training
and held-out data. If a diagnosis would select the true one of the two, its search missed it. If that is clearly ahead
and still not selected, its further cause explains less than a diagnosis asks for. If neither is ahead by the margin,
the log can't tell them apart. If the answer's set is clearly ahead, the true law has another form than the catalogue's,
or the noise of the log favours the other.

python benchmarks/true_set.py results/rigs --jobs 2
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

import ehsa_ctrl
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses, Task, hypothesis_key
from ehsa_ctrl.diagnosis.model_selection import Reference, select_model
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, segment_candidates, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.scoring import ScoredHypothesis, Scoring
from ehsa_ctrl.diagnosis.validation_segment import windows_of
from ehsa_ctrl.physics.effects import CandidateEffect

# The bench's modules are scripts beside one another, which do not know the package.
sys.path.append(str(Path(__file__).parent / "withheld"))
from answer_score import NAMING, acting_effects, score_answer
from effects_outside import OUTSIDE
from key_formats import read_key
from score import read_answers, settings_of

THRESHOLD = 0.03
#: Most combinations of forms of the true effects that are fitted.
MOST_FORMS = 6
SEARCH, SELECTION, UNTOLD = "the search missed it", "its further cause explains too little", "the log can't tell"
OTHER, ABSENT = "the other fits better", "no such form"


@dataclass(frozen=True)
class Comparison:
    """The true set beside that of the answer. ahead: deviance by which the true set is better, in margins."""

    name: str
    truth: tuple[str, ...]
    answer: tuple[str, ...]
    ahead: float | None
    why: str

    @property
    def row(self) -> str:
        ahead = "" if self.ahead is None else f"{self.ahead:+.1f}"
        return f"| {self.name} | {' + '.join(self.truth)} | {' + '.join(self.answer)} | {ahead} | {self.why} |"


def compare(cases: Path, name: str, key: Mapping[str, Any], answer: Mapping[str, Any]) -> Comparison:
    """The comparison of one case whose answer names causes."""
    settings = json.loads((cases / f"{name}.json").read_text())
    plant = ehsa_ctrl.load_plant(settings["plant"], model=settings["model"], settings=settings_of(settings))
    log, second = (
        ehsa_ctrl.read_plant_log(cases / settings[one], plant) if settings.get(one) else None
        for one in ("log", "validate")
    )
    prepared = prepare_logs(plant, [log], second, THRESHOLD, check=True)
    segments = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True)
    objective, sensitivities = objective_of(segments.training, THRESHOLD)
    candidates = segment_candidates(segments.training)
    effects = acting_effects(key)
    names = tuple(one["id"] for one in effects), tuple(one["id"] for one in answer["effects"])
    true_sets = _sets(effects, candidates)
    named = [_nearest(one, candidates) for one in answer["effects"]]
    if not true_sets or None in named:
        return Comparison(name, *names, None, ABSENT)
    tasks = [Task(tuple(one for one in named if one), _sizes(answer["effects"]))]
    tasks += [Task(members, _starts(members) | _sizes(effects)) for members in true_sets]
    hypotheses = Hypotheses.initial(objective, candidates, sensitivities, Pool())
    windows = windows_of([one.plant for one in prepared.logs], segments.training)
    for _ in range(2):
        # Again with the level of the best: blocks that it leaves are weighted down.
        hypotheses = hypotheses.with_converged_refits(tasks, "", windows)
        hypotheses = hypotheses.with_level_of(hypotheses.best()[0])
    scoring = Scoring.of(hypotheses, segments.training, segments.held_out, THRESHOLD, lumped=False)
    scored = [_scored(scoring, hypotheses, task) for task in tasks]
    given, true = scored[0], min((one for one in scored[1:] if one), key=lambda one: one.deviance, default=None)
    if given is None or true is None:
        return Comparison(name, *names, None, ABSENT)
    reference = Reference.of(scoring)
    ahead = (given.deviance - true.deviance) / reference.margin(min(given, true, key=lambda one: one.deviance))
    selected = select_model([given, true], reference).chosen is true
    why = SEARCH if selected else SELECTION if ahead > 1.0 else UNTOLD if ahead > -1.0 else OTHER
    return Comparison(name, *names, ahead, why)


def _scored(scoring: Scoring, hypotheses: Hypotheses, task: Task) -> ScoredHypothesis | None:
    fit = hypotheses.fits.get(hypothesis_key(task.candidates))
    return None if fit is None else scoring.score(fit)


def _sets(
    effects: Sequence[Mapping[str, Any]], candidates: Sequence[CandidateEffect]
) -> list[tuple[CandidateEffect, ...]]:
    """The sets of forms of these effects in the catalogue."""
    forms = [[c for c in candidates if c.key == (one["id"], one.get("channel"))] for one in effects]
    found = []
    for members in itertools.islice(itertools.product(*forms), MOST_FORMS):
        free = [name for one in members for name in one.names]
        if len(set(free)) == len(free):
            found.append(members)
    return found


def _nearest(effect: Mapping[str, Any], candidates: Sequence[CandidateEffect]) -> CandidateEffect | None:
    """The form of an effect with the parameters that the answer states."""
    stated = set(effect["parameters"])
    forms = [c for c in candidates if c.key == (effect["id"], effect.get("channel"))]
    return min(forms, key=lambda c: len(stated ^ set(c.names)), default=None)


def _starts(members: Sequence[CandidateEffect]) -> dict[str, float]:
    return {n: v for one in members for n, v in zip(one.names, one.starts[0], strict=True)}


def _sizes(effects: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Name -> size of the plant's parameters in a key or an answer; those of sensors are under another name."""
    found = {n: v for one in effects if not one.get("channel") for n, v in (one.get("parameters") or {}).items()}
    return {n: float(v["value"] if isinstance(v, Mapping) else v) for n, v in found.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Compare the true causes with those of answers that are wrong.")
    parser.add_argument("cases", type=Path, help="folder of cases.py with answers of score.py")
    parser.add_argument("--answers", type=Path, help="folder of the answers (default: CASES/answers)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="compare only these cases")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args(arguments)
    keys = read_key(options.cases / "key.json")
    answers = read_answers(options.answers or options.cases / "answers", list(keys))
    due = []
    for name in options.only or sorted(keys):
        answer, row = answers[name], score_answer(name, keys[name], answers[name])
        names_causes = answer is not None and answer["verdict"] in NAMING
        if names_causes and row.verdict not in (OUTSIDE, "no_gap") and (row.missed or row.wrong):
            due.append(name)
    work = (delayed(compare)(options.cases, name, keys[name], answers[name]) for name in due)
    rows = Parallel(options.jobs, verbose=1)(work)
    print("| case | truth | answer | truth ahead, in margins | why |\n|---|---|---|---|---|")
    print("\n".join(one.row for one in rows))
    print(f"\n{len(rows)} cases: " + ", ".join(f"{why} {n}" for why, n in Counter(r.why for r in rows).most_common()))


if __name__ == "__main__":
    main()
