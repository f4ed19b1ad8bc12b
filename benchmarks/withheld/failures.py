"""The cases in which something is wrong, each with the truth beside the answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from answer_score import FAILED, AnswerScore
from effects_outside import OUTSIDE
from score_statistics import closes


def faults(row: AnswerScore) -> list[str]:
    """What is wrong with an answer, in words; empty if nothing is."""
    if row.answer == FAILED:
        return ["no answer"]
    if row.verdict == "no_gap":
        return [] if row.answer == "no_gap" else ["false alarm"]
    out = [f"wrong name {id}" for id in row.wrong]
    if row.verdict == OUTSIDE:
        return out
    if row.answer == "no_gap":
        return ["gap not seen"]
    if not row.in_set:
        out.append("first name wrong" if row.set_size else "nothing named")
    elif not row.top_1:
        out.append("cause in the set, not first")
    out += [f"{id} missed" for id in row.missed]
    if row.closable and row.closable > 0.0 and not closes(row):
        # Without a better model the answer has no gap of its own.
        again = f", {100.0 * row.repeatable:.0f} % with other input noise" if row.repeatable is not None else ""
        out.append(
            f"closes {100.0 * (row.closed or 0.0):.0f} % of the gap, the truth {100.0 * row.closable:.0f} %{again}"
        )
    if not all(row.in_interval):
        out.append(f"{row.in_interval.count(False)} of {len(row.in_interval)} sizes outside their interval")
    return out


def failure_table(
    rows: Sequence[AnswerScore],
    keys: Mapping[str, Mapping[str, Any]],
    answers: Mapping[str, Mapping[str, Any] | None],
) -> str:
    """Markdown: case, truth with law and gap alone, answer with probabilities, faults."""
    failed = [(row, wrong) for row in rows if (wrong := faults(row))]
    lines = [f"**Failures: {len(failed)} of {len(rows)} cases**", ""]
    if not failed:
        return lines[0]
    lines += ["| case | family | truth | answer | what is wrong |", "|---|---|---|---|---|"]
    for row, wrong in failed:
        cells = (row.name, row.family, _truth(keys[row.name]), _answer(answers[row.name]), "; ".join(wrong))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _truth(key: Mapping[str, Any]) -> str:
    causes = []
    for effect in key["effects"]:
        details = [d for d in (effect.get("channel"), effect.get("law")) if d and d != effect["id"]]
        if effect.get("alone"):
            details.append(f"{100.0 * max(effect['alone'].values()):.1f} % alone")
        causes.append(f"{effect['id']} ({', '.join(details)})" if details else effect["id"])
    return " + ".join(causes) or "no gap"


def _answer(answer: Mapping[str, Any] | None) -> str:
    if answer is None:
        return FAILED
    names = []
    for effect in answer["effects"]:
        same = [effect["id"], *(effect.get("ambiguous_with") or [])]
        channel = f" {effect['channel']}" if effect.get("channel") else ""
        names.append(f"{' or '.join(same)}{channel} {float(effect['probability']):.2f}")
    return f"{answer['verdict']}: {' + '.join(names)}" if names else str(answer["verdict"])
