"""Score the laws that diagnoses propose for effects outside the catalogue.

python benchmarks/withheld/score.py results/withheld/tuning --only NAME ...
python benchmarks/withheld/law_score.py results/withheld/tuning

A case of an effect that the catalogue lacks counts by its law: variable (place and variables of the first form),
form (in a set of at most three), and what the law closes beside what the true structure closes. Effects that no
expression of the tool's grammar describes, such as an unmeasured random force or an error of a sensor, should get no
law at all; so should a log without a gap, and one whose effects the catalogue has. False laws are counted with

python benchmarks/withheld/cases.py --set reported --family none production --count 40 --out results/withheld/no_gap
python benchmarks/withheld/score.py results/withheld/no_gap
python benchmarks/withheld/law_score.py results/withheld/no_gap
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from law_truth import OUTSIDE_TRUTHS, SET

#: Share of the closable gap that a law should close.
CLOSED = 0.9


@dataclass(frozen=True)
class LawScore:
    """Score of one answer.

    law: of the bench, or the effects of the catalogue that act; empty without a gap. right_*: None where no expression
    is right.
    """

    name: str
    law: str
    proposed: bool
    right_variable: bool | None
    right_form: bool | None
    closed: float | None
    closable: float
    seconds: float

    @property
    def enough(self) -> bool | None:
        """Whether the law closes most of what the true structure closes."""
        return None if self.right_form is None else (self.closed or 0.0) >= CLOSED * self.closable


def score_law(name: str, key: Mapping[str, Any], answer: Mapping[str, Any]) -> LawScore:
    """The score of a diagnosis.json beside the key of its case."""
    laws = [effect["law"] for effect in key["effects"] if effect["id"] == "outside_catalogue"]
    known = " + ".join(effect["id"] for effect in key["effects"])
    law, truth = (laws[0], OUTSIDE_TRUTHS.get(laws[0])) if laws else (known, None)
    closable = closable_of(key) if laws else 0.0
    found = answer.get("law")
    variable = form = None
    if truth is not None:
        variable, form = truth.variable_in(found), truth.form_in(found)
    closed = found["forms"][0]["gap_closed"] if found else None
    return LawScore(name, law, bool(found), variable, form, closed, closable, answer["seconds"])


def closable_of(key: Mapping[str, Any]) -> float:
    """Share of the nominal gap that the true structure closes on held-out data."""
    gap = key.get("held_out", {}).get("gap", {})
    return 1.0 - gap["truth"]["total"] / gap["nominal"]["total"] if gap else 0.0


def table(rows: Sequence[LawScore]) -> str:
    """The cases, and the shares over those whose law has an expression."""

    def word(value: bool | None) -> str:
        return "" if value is None else "yes" if value else "no"

    lines = ["| case | law | proposed | variable | form | closes | closable | s |", "|---|---|---|---|---|---|---|---|"]
    for row in rows:
        closed = "" if row.closed is None else f"{row.closed:.2f}"
        lines.append(
            f"| {row.name} | {row.law or 'no gap'} | {word(row.proposed)} | {word(row.right_variable)} | "
            f"{word(row.right_form)} | {closed} | {row.closable:.2f} | {row.seconds:.0f} |"
        )
    told = [row for row in rows if row.right_form is not None]
    nothing = [row for row in rows if not row.law]
    untold = [row for row in rows if row.right_form is None and row.law]
    for words, values in {
        "variable right": [row.right_variable for row in told],
        f"form right or in a set of {SET}": [row.right_form for row in told],
        f"closes {100 * CLOSED:.0f} % of what the truth closes": [row.enough for row in told],
        "nothing proposed where no expression is right": [not row.proposed for row in untold],
        "nothing proposed without a gap": [not row.proposed for row in nothing],
    }.items():
        lines.append(f"\n{words}: {sum(map(bool, values))} of {len(values)}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Score the laws of existing answers.")
    parser.add_argument("cases", type=Path, help="folder of cases.py, with keys/ and answers/")
    parser.add_argument("--answers", type=Path, help="folder of the answers (default: CASES/answers)")
    options = parser.parse_args(arguments)
    answers = options.answers or options.cases / "answers"
    rows = []
    for file in sorted(answers.glob("*/diagnosis.json")):
        name = file.parent.name
        key = json.loads((options.cases / "keys" / f"{name}.json").read_text())
        rows.append(score_law(name, key, json.loads(file.read_text())))
    print(table(rows))


if __name__ == "__main__":
    main()
