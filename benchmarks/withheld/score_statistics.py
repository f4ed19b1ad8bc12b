"""Statistics of a scored set: shares with Wilson intervals, means and medians with bootstrap intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from answer_score import FAILED, AnswerScore
from effects import IDS
from effects_outside import OUTSIDE
from scipy.stats import binomtest, bootstrap

#: Probabilities are clipped to this before the logarithm; it is also that of an id that is not listed.
FLOOR = 0.005
Rows = Sequence[AnswerScore]


@dataclass(frozen=True)
class Figure:
    """One line of the table. `count`: number of cases of the share or mean."""

    label: str
    value: float
    low: float
    high: float
    count: int
    kind: str = "share"

    def text(self) -> str:
        if self.count == 0:
            return f"| {self.label} | - | - | 0 |"
        percent = self.kind == "share"
        one: Callable[[float], str] = (lambda v: f"{100 * v:.1f} %") if percent else (lambda v: f"{v:.3g}")
        return f"| {self.label} | {one(self.value)} | {one(self.low)} to {one(self.high)} | {self.count} |"


def share(label: str, hits: Sequence[bool]) -> Figure:
    n, k = len(hits), sum(map(bool, hits))
    if n == 0:
        return Figure(label, float("nan"), float("nan"), float("nan"), 0)
    interval = binomtest(k, n).proportion_ci(method="wilson")
    return Figure(label, k / n, float(interval.low), float(interval.high), n)


def centre(label: str, values: Sequence[float | None], of: Callable[..., np.floating] = np.mean) -> Figure:
    y = np.array([v for v in values if v is not None and np.isfinite(v)])
    if y.size == 0:
        return Figure(label, float("nan"), float("nan"), float("nan"), 0, "number")
    value = float(of(y))
    if y.size < 3 or np.ptp(y) == 0.0:
        return Figure(label, value, value, value, y.size, "number")
    interval = bootstrap((y,), of, n_resamples=1000, method="percentile", rng=np.random.default_rng(0))
    low, high = interval.confidence_interval
    return Figure(label, value, float(low), float(high), y.size, "number")


def skill(label: str, answered: np.ndarray, guessed: np.ndarray) -> Figure:
    """1 - loss / loss of guessing, over all cases; the interval draws cases."""

    def of(a: np.ndarray, b: np.ndarray) -> float:
        return float(1.0 - np.sum(a) / np.sum(b))

    value = of(answered, guessed)
    if answered.size < 3 or np.ptp(answered - guessed * (1.0 - value)) < 1e-12:
        return Figure(label, value, value, value, answered.size, "number")
    interval = bootstrap(
        (answered, guessed), of, paired=True, vectorized=False, n_resamples=1000, method="percentile", rng=1
    ).confidence_interval
    return Figure(label, value, float(interval.low), float(interval.high), answered.size, "number")


def losses(row: AnswerScore, guess: float | None = None) -> tuple[float, float]:
    """Log-loss and Brier score of one case, summed over the ids; with `guess`, of that one probability for all."""
    kept = [(p, label) for p, label in zip(row.probabilities, row.labels, strict=True) if label is not None]
    p = np.array([guess if guess is not None else p for p, _ in kept])
    y = np.array([label for _, label in kept])
    held = np.clip(p, FLOOR, 1.0 - FLOOR)
    return float(-np.sum(y * np.log(held) + (1 - y) * np.log(1.0 - held))), float(np.sum((p - y) ** 2))


def uniform_guess(rows: Rows) -> float:
    """The best guess with the same probability for every id: the share of causes among ids."""
    labels = [label for row in rows for label in row.labels if label is not None]
    return sum(labels) / len(labels)


def probability_figures(rows: Rows) -> list[Figure]:
    """Probabilities of the answers and of the uniform guess, over all cases whose causes are catalogued."""
    rows = [r for r in rows if r.verdict != OUTSIDE]
    if not rows:
        return []
    guess = uniform_guess(rows)
    answered, guessed = np.array([losses(r) for r in rows]), np.array([losses(r, guess) for r in rows])
    out = [
        centre("log-loss of a case", answered[:, 0]),
        centre("log-loss of uniform guessing", guessed[:, 0]),
        centre("Brier score of a case", answered[:, 1]),
        centre("Brier score of uniform guessing", guessed[:, 1]),
    ]
    if guess == 0.0:
        return out
    names = ("log-loss", "Brier score")
    return out + [skill(f"skill in {names[k]} (1 perfect, 0 guessing)", answered[:, k], guessed[:, k]) for k in (0, 1)]


def single_figures(rows: Rows) -> list[Figure]:
    named = [r for r in rows if r.in_set]
    return [
        share("top-1: first id is the cause", [r.top_1 for r in rows]),
        share("the cause is in the set", [r.in_set for r in rows]),
        share("named alone and right", [r.in_set and r.set_size == 1 for r in rows]),
        share("named alone and wrong", [r.answer == "effect" and not r.in_set for r in rows]),
        share("a set without the cause", [r.answer == "ambiguous" and not r.in_set for r in rows]),
        share("abstained: outside or underdetermined", [r.answer in (OUTSIDE, "underdetermined") for r in rows]),
        share("missed: no gap", [r.answer == "no_gap" for r in rows]),
        share("something wrong named beside", [r.in_set and r.wrong > 0 for r in rows]),
        share("place right", [r.place_right for r in rows]),
        centre("size of a set that holds the cause", [r.set_size for r in named]),
        centre("probability on the cause, where a gap was seen", [r.on_truth for r in rows if r.answer != "no_gap"]),
    ]


def several_figures(rows: Rows) -> list[Figure]:
    return [
        share("all causes named", [r.found >= len(r.truth) for r in rows]),
        share("at least one named", [r.found > 0 for r in rows]),
        share("exactly the causes named", [r.found >= len(r.truth) and r.wrong == 0 for r in rows]),
        share("something wrong named", [r.wrong > 0 for r in rows]),
        share("abstained: outside or underdetermined", [r.answer in (OUTSIDE, "underdetermined") for r in rows]),
    ]


def shrinkage_figures(rows: Rows) -> list[Figure]:
    """Gap closed on held-out data where causes of the catalogue are named, compared with the true structure."""
    named = [r for r in rows if r.truth and OUTSIDE not in r.truth and r.answer in ("effect", "ambiguous")]
    both = [(r.closed, r.closable) for r in named if r.closed is not None and r.closable and r.closable > 0.0]
    part = [closed / closable for closed, closable in both]
    return [
        centre("gap closed by the answer, median", [r.closed for r in named], np.median),
        centre("gap closed by the true structure, median", [closable for _, closable in both], np.median),
        centre("answer over true structure, median", part, np.median),
        share("answer closes at least 95 % of what the truth does", [p >= 0.95 for p in part]),
        share("sizes within the larger of 10 % and two deviations", [right for r in named for right in r.sizes]),
    ]


def sections(rows: Rows) -> dict[str, list[Figure]]:
    """All figures by heading."""
    plain = [r for r in rows if r.family != "weak"]
    weak = [r for r in rows if r.family == "weak" and r.verdict == "effect"]
    none = [r for r in rows if r.verdict == "no_gap"]
    single = [r for r in plain if r.verdict == "effect" and len(r.truth) == 1]
    several = [r for r in plain if r.verdict == "effect" and len(r.truth) > 1]
    outside = [r for r in rows if r.verdict == OUTSIDE]
    held = [r.answer == "underdetermined" or r.in_set for r in weak]
    out = {
        "All": [
            share("answered", [r.answer != FAILED for r in rows]),
            centre("seconds of a diagnosis, median", [r.seconds for r in rows], np.median),
        ],
        "No gap": [
            share("false alarms", [r.answer != "no_gap" for r in none]),
            share("false alarms that name something", [r.answer in ("effect", "ambiguous") for r in none]),
        ],
        "One cause": single_figures(single),
        "Several causes": several_figures(several),
        "Outside the catalogue": [
            share("answered outside_catalogue", [r.answer == OUTSIDE for r in outside]),
            share("a wrong name", [r.answer in ("effect", "ambiguous") for r in outside]),
            share("abstained: underdetermined", [r.answer == "underdetermined" for r in outside]),
            share("missed: no gap", [r.answer == "no_gap" for r in outside]),
            share("place right", [r.place_right for r in outside]),
        ],
        "Weak excitation": [
            share("underdetermined, or the cause is in the set", held),
            share("named alone and wrong", [r.answer == "effect" and not r.in_set for r in weak]),
            share("named alone and right", [r.in_set and r.set_size == 1 for r in weak]),
        ],
        "Probabilities": probability_figures(rows),
        "Gap closed on held-out data": shrinkage_figures(rows),
    }
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
