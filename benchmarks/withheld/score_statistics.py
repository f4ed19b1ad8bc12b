"""All figures of a scored set, by heading, and the confusion matrix."""

from __future__ import annotations

from collections import Counter

import numpy as np
from answer_score import FAILED, NAMING, AnswerScore
from calibration import Rows, calibration_figures, probability_figures
from effects import IDS
from effects_outside import OUTSIDE
from figures import Figure, centre, share

#: An answer closes the gap if it closes this share of what the true structure closes.
CLOSES = 0.95


def single_figures(rows: Rows) -> list[Figure]:
    named = [r for r in rows if r.in_set]
    return [
        share("top-1: first id is the cause", [r.top_1 for r in rows]),
        share("the cause is in the set", [r.in_set for r in rows]),
        share("named alone and right", [r.in_set and r.set_size == 1 for r in rows]),
        share("named alone and wrong", [r.set_size == 1 and not r.in_set for r in rows]),
        share("a set without the cause", [r.set_size > 1 and not r.in_set for r in rows]),
        share("abstained: outside or underdetermined", [r.answer in (OUTSIDE, "underdetermined") for r in rows]),
        share("missed: no gap", [r.answer == "no_gap" for r in rows]),
        share("something wrong named beside", [r.in_set and bool(r.wrong) for r in rows]),
        share("place right", [r.place_right for r in rows]),
        centre("size of a set that holds the cause", [r.set_size for r in named]),
        centre("probability on the cause, where a gap was seen", [r.on_truth for r in rows if r.answer != "no_gap"]),
    ]


def several_figures(rows: Rows) -> list[Figure]:
    return [
        share("all causes named", [r.found >= len(r.truth) for r in rows]),
        share("at least one named", [r.found > 0 for r in rows]),
        share("exactly the causes named", [r.found >= len(r.truth) and not r.wrong for r in rows]),
        share("something wrong named", [bool(r.wrong) for r in rows]),
        share("abstained: outside or underdetermined", [r.answer in (OUTSIDE, "underdetermined") for r in rows]),
    ]


def shrinkage_figures(rows: Rows) -> list[Figure]:
    """Gap closed on held-out data where causes of the catalogue are named, compared with the true structure."""
    named = [r for r in rows if r.truth and OUTSIDE not in r.truth and r.answer in NAMING]
    both = [(r.closed, r.closable) for r in named if r.closed is not None and r.closable and r.closable > 0.0]
    part = [closed / closable for closed, closable in both]
    return [
        centre("gap closed by the answer, median", [r.closed for r in named], np.median),
        centre("gap closed by the true structure, median", [closable for _, closable in both], np.median),
        centre("answer over true structure, median", part, np.median),
        share("answer closes at least 95 % of what the truth does", [p >= CLOSES for p in part]),
        share("sizes within the larger of 10 % and two deviations", [right for r in named for right in r.sizes]),
        share("95 % intervals of sizes that hold the truth", [inside for r in named for inside in r.in_interval]),
    ]


def family_figures(rows: Rows) -> list[Figure]:
    """What matters most, family by family."""
    out = []
    for family in sorted({r.family for r in rows} - {""}):
        part = [r for r in rows if r.family == family]
        none = [r for r in part if r.verdict == "no_gap"]
        outside = [r for r in part if r.verdict == OUTSIDE]
        caused = [r for r in part if r.verdict == "effect"]
        if none:
            out.append(share(f"{family}: no gap, quiet", [r.answer == "no_gap" for r in none]))
        if outside:
            named = [r for r in outside if r.answer != FAILED and not r.wrong]
            out.append(share(f"{family}: outside, no wrong name", [r in named for r in outside]))
        if caused:
            out += [share(f"{family}: {label}", hits) for label, hits in cause_shares(caused).items()]
    return out


def cause_shares(rows: Rows) -> dict[str, list[bool]]:
    """Per case with causes of the catalogue, except the intervals: per size."""
    return {
        "first name right": [r.top_1 for r in rows],
        "a cause in the first set": [r.in_set for r in rows],
        "every cause named": [r.found >= len(r.truth) for r in rows],
        "every cause listed, whatever its probability": [r.listed >= len(r.truth) for r in rows],
        "no wrong name beside": [r.answer != FAILED and not r.wrong for r in rows],
        "closes 95 % of what the truth closes": [closes(r) for r in rows if r.closable and r.closable > 0.0],
        "that, or as much as the truth with other input noise": [
            closes(r) or repeats(r) for r in rows if r.closable and r.closable > 0.0 and r.repeatable is not None
        ],
        "95 % intervals hold the truth": [inside for r in rows for inside in r.in_interval],
    }


def closes(row: AnswerScore) -> bool:
    """Whether the answer closes 95 % of what the truth closes; an answer without a better model closes nothing."""
    return bool(row.closed is not None and row.closable and row.closed >= CLOSES * row.closable)


def repeats(row: AnswerScore) -> bool:
    """Whether the answer closes as much as the truth does where the noise of the logged current is drawn again."""
    return bool(row.closed is not None and row.repeatable is not None and row.closed >= row.repeatable)


def sections(rows: Rows) -> dict[str, list[Figure]]:
    """All figures by heading."""
    plain = [r for r in rows if r.family != "weak"]
    weak = [r for r in rows if r.family == "weak" and r.verdict == "effect"]
    none = [r for r in rows if r.verdict == "no_gap"]
    single = [r for r in plain if r.verdict == "effect" and len(r.truth) == 1]
    several = [r for r in plain if r.verdict == "effect" and len(r.truth) > 1]
    outside = [r for r in rows if r.verdict == OUTSIDE]
    caused = [r for r in plain if r.verdict == "effect"]
    held = [r.answer == "underdetermined" or r.in_set for r in weak]
    out = {
        "All": [
            share("answered", [r.answer != FAILED for r in rows]),
            centre("seconds of a diagnosis, median", [r.seconds for r in rows], np.median),
        ],
        "With causes of the catalogue": [share(label, hits) for label, hits in cause_shares(caused).items()],
        "No gap": [
            share("false alarms", [r.answer != "no_gap" for r in none]),
            share("false alarms that name something", [r.answer in NAMING for r in none]),
        ],
        "One cause": single_figures(single),
        "Several causes": several_figures(several),
        "Outside the catalogue": [
            share("answered outside_catalogue", [r.answer == OUTSIDE for r in outside]),
            share("a wrong name", [bool(r.wrong) for r in outside]),
            share("abstained: underdetermined", [r.answer == "underdetermined" for r in outside]),
            share("missed: no gap", [r.answer == "no_gap" for r in outside]),
            share("place right", [r.place_right for r in outside]),
        ],
        "Weak excitation": [
            share("underdetermined, or the cause is in the set", held),
            share("named alone and wrong", [r.set_size == 1 and not r.in_set for r in weak]),
            share("named alone and right", [r.in_set and r.set_size == 1 for r in weak]),
        ],
        "Probabilities": probability_figures(rows),
        "Reliability: share of causes among listed ids, by probability": calibration_figures(rows),
        "Gap closed on held-out data": shrinkage_figures(rows),
    }
    if len({r.family for r in rows}) > 1:
        out["By family"] = family_figures(rows)
    groups = {
        "gap 1 to 2 thresholds": lambda r: r.largest < 0.06,
        "gap 2 to 4 thresholds": lambda r: 0.06 <= r.largest < 0.12,
        "gap over 4 thresholds": lambda r: r.largest >= 0.12,
        "open loop": lambda r: r.loop == "open",
        "slow centring loop": lambda r: r.loop == "centring",
        "position controller": lambda r: r.loop == "position",
        "with load cell": lambda r: r.load_cell,
        "without load cell": lambda r: not r.load_cell,
    }
    out["One cause, the cause is in the set, by group"] = [
        share(label, [r.in_set for r in single if belongs(r)]) for label, belongs in groups.items()
    ]
    return out


def confusion(rows: Rows) -> tuple[list[str], list[str], np.ndarray]:
    """Rows: every cause in the keys, "no_gap" without a cause. Columns: the first id, or the verdict.

    A case with several causes counts once in the row of each.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for row in rows:
        for id in row.truth or ("no_gap",):
            counts[id, id if row.top_1 and len(row.truth) == 1 else row.first] += 1
    order = (*IDS, OUTSIDE, "no_gap", "underdetermined", FAILED)
    rank = {id: k for k, id in enumerate(order)}
    down = sorted({a for a, _ in counts}, key=lambda id: rank.get(id, 99))
    across = sorted({b for _, b in counts}, key=lambda id: rank.get(id, 99))
    return down, across, np.array([[counts[a, b] for b in across] for a in down])
