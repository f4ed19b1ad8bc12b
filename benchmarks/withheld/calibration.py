"""Probabilities against what was true: log-loss, Brier score, reliability and expected calibration error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from answer_score import AnswerScore
from effects_outside import OUTSIDE
from figures import Figure, centre, share, skill

#: Probabilities are clipped to this before the logarithm; it is also that of an id that is not listed.
FLOOR = 0.005
#: Bins of the reliability diagram, of equal width.
BINS = 10
RESAMPLES = 1000
Rows = Sequence[AnswerScore]


@dataclass(frozen=True)
class Bin:
    """Listed ids whose probability is in a range: edges, mean probability, and the share of them that are causes."""

    low: float
    high: float
    mean: float
    present: Figure


def listed(row: AnswerScore) -> np.ndarray:
    """(K, 2) probability and label of the ids that the answer lists; equivalents of a cause are left out."""
    pairs = [(p, label) for p, label in zip(row.probabilities, row.labels, strict=True) if label is not None and p > 0]
    return np.array(pairs, dtype=float).reshape(-1, 2)


def _bin_of(probability: np.ndarray) -> np.ndarray:
    return np.minimum((probability * BINS).astype(int), BINS - 1)


def reliability(rows: Rows) -> list[Bin]:
    """Bins that hold anything. Ids that are not listed are left out, as they would outnumber all others."""
    pairs = np.concatenate([listed(r) for r in rows]) if rows else np.empty((0, 2))
    index = _bin_of(pairs[:, 0])
    out = []
    for k in np.unique(index):
        p, label = pairs[index == k].T
        low, high = k / BINS, (k + 1) / BINS
        out.append(Bin(low, high, float(p.mean()), share(f"probability {low:.1f} to {high:.1f}", list(label > 0))))
    return out


def calibration_error(pairs: np.ndarray) -> float:
    """Mean over listed ids of |mean probability - share of causes| of their bin; nan without any."""
    if not pairs.size:
        return float("nan")
    index = _bin_of(pairs[:, 0])
    counts = np.bincount(index, minlength=BINS)
    difference = np.bincount(index, pairs[:, 0] - pairs[:, 1], minlength=BINS)
    return float(np.abs(difference).sum() / counts.sum())


def calibration_figures(rows: Rows) -> list[Figure]:
    """Expected calibration error with its interval over cases, then the bins."""
    by_case = [pairs for pairs in map(listed, rows) if pairs.size]
    label = "expected calibration error of listed ids"
    if len(by_case) < 3:
        return [Figure(label, float("nan"), float("nan"), float("nan"), 0, "number")]
    rng = np.random.default_rng(0)
    errors = [
        calibration_error(np.concatenate([by_case[k] for k in rng.integers(len(by_case), size=len(by_case))]))
        for _ in range(RESAMPLES)
    ]
    low, high = np.quantile(errors, [0.025, 0.975])
    value = calibration_error(np.concatenate(by_case))
    return [
        Figure(label, value, float(low), float(high), len(by_case), "number"),
        *(b.present for b in reliability(rows)),
    ]


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
