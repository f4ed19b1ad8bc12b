"""Score the laws that diagnoses propose for effects outside the catalogue.

python benchmarks/withheld/score.py results/withheld/tuning --only NAME ...
python benchmarks/withheld/law_score.py results/withheld/tuning

A case of an effect that the catalogue lacks counts by its law: variable (place and variables of the first form),
form (in a set of at most three), and what the law closes beside what the true structure closes. Effects that no
expression of the tool's grammar describes, such as an unmeasured random force or an error of a sensor, should get no
law at all; so should a log without a gap.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Most forms of a set that counts as right, and the share of the closable gap that a law should close.
SET, CLOSED = 3, 0.9
FLOWS = ("pump_flow", "flow_1", "flow_2")


@dataclass(frozen=True)
class Truth:
    """A law of the bench as the tool would write it: places, words of its variables, and pieces of a right form."""

    places: tuple[str, ...]
    variables: tuple[str, ...]
    forms: tuple[str, ...]


#: Law of the bench -> what would be right. The others have no expression.
TRUTHS = {
    "flow_ripple": Truth(FLOWS, ("omega", "angle"), ("sin(",)),
    "leak_growth": Truth(FLOWS, ("P_", "time"), ("* c_m_",)),
    "one_way_leak": Truth(FLOWS, ("(P_1 - P_2)",), ("max((P_1 - P_2)", "abs((P_1 - P_2))")),
    "heat_droop": Truth(("torque",), ("current", "time"), ("current * (1 - exp(", "current * c_m_")),
    "memory": Truth(("force",), ("reversal",), ("(d_R - c_m_",)),
    "jam": Truth(("force",), ("time",), ("d_R * 0.5 * (1 + tanh(",)),
    "brake": Truth(("torque",), ("current",), ("d_M * 0.5 * (1 + tanh(", "d_M * exp(-", "d_M * max(1 - ")),
    "drive_step": Truth(("torque", "drive"), ("current",), ("sin(current",)),
}


@dataclass(frozen=True)
class LawScore:
    """Score of one answer. law: of the bench, empty without a gap. right_*: None where no expression is right."""

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
    law, truth = (laws[0], TRUTHS.get(laws[0])) if laws else ("", None)
    gap = key.get("held_out", {}).get("gap", {})
    closable = 1.0 - gap["truth"]["total"] / gap["nominal"]["total"] if laws and gap else 0.0
    found = answer.get("law")
    variable = form = None
    if truth is not None:
        forms = [one["expression"] for one in found["forms"][:SET]] if found else []
        shown = " ".join(found["variables"]) if found else ""
        variable = bool(found) and found["place"] in truth.places and all(word in shown for word in truth.variables)
        form = variable and any(piece in text for text in forms for piece in truth.forms)
    closed = found["forms"][0]["gap_closed"] if found else None
    return LawScore(name, law, bool(found), variable, form, closed, closable, answer["seconds"])


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
    untold = [row for row in rows if row.right_form is None]
    for words, values in {
        "variable right": [row.right_variable for row in told],
        f"form right or in a set of {SET}": [row.right_form for row in told],
        f"closes {100 * CLOSED:.0f} % of what the truth closes": [row.enough for row in told],
        "nothing proposed where no expression is right": [not row.proposed for row in untold],
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
