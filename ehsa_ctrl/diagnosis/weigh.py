"""The verdict: which set of causes, what can't be excluded beside it, how probable each is, and when to abstain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .diagnosis import Verdict
from .judge import Judged, Key, by_label
from .signals import largest

#: A rival can't be excluded within this evidence, or this share of what the best model leaves unexplained, or this
#: share of what it explains.
CLOSE, CLOSE_LEFT, CLOSE_EXPLAINED = 12.0, 0.3, 0.004
#: One more cause has to take this share of the threshold off a gap (in quadrature), or this share of the evidence.
WORTHWHILE, WORTHWHILE_SHARE = 0.5, 0.02
#: No set of causes is right where the best one leaves this share of the gap where it was fitted, and residuals whose
#: mean square is larger than noise by this much; or most of the gap and this share of the evidence.
LEFT, EXCESS = 0.25, 0.3
MOST_LEFT, UNEXPLAINED = 0.5, 0.06
#: Nor where it leaves this share of what is slow, and more of it than noise and what is tolerated of a model in a
#: sample; beyond what was fitted errors that add up are larger.
SLOW_LEFT, SLOW_SIZE = (0.06, 0.35), (0.8, 1.0)
#: Sets of more rivals than this say that the log does not excite what would tell them apart.
CROWD = 4


@dataclass(frozen=True)
class Weighed:
    """What is held for true.

    verdict. chosen: the hypothesis. rivals: cause -> those that could stand in its place. probability: of each cause
    that any hypothesis has, being present. labels: the best hypothesis of each set of causes, best first.
    rest: share of the nominal model's evidence that the chosen one leaves; left: of the gap where it was fitted.
    unlike: above one, none of the catalogue's effects is what happened.
    """

    verdict: Verdict
    chosen: Judged
    rivals: Mapping[Key, tuple[Key, ...]]
    probability: Mapping[Key, float]
    labels: tuple[Judged, ...]
    rest: float
    left: float
    unlike: float


def weigh(
    judged: Sequence[Judged],
    least: float,
    most: float,
    threshold: float,
    gaps: Mapping[str, Mapping[str, float]],
    expected: float,
    shaken: float = 0.0,
) -> Weighed:
    """Choose among hypotheses.

    least, most: evidence that noise alone leaves, and the nominal model. gaps: "fitted" and "held" of the nominal one.
    expected: mean square of residuals that are noise. shaken: gap that noise of the logged current makes by itself.
    """
    # A model that is off by more than the signals themselves is no worse than one that does not move at all.
    most = least + (most - least) / max(gaps["fitted"]["total"], 1.0) ** 2
    labels = sorted(by_label(judged).values(), key=lambda j: j.evidence)
    named = [j for j in labels if j.causes] or labels
    chosen = _smallest(named, least, most, threshold)
    chosen = _simplest(named, chosen, _close(chosen, least, most))
    unexplained = max(chosen.evidence - least, 0.0)
    rest = unexplained / max(most - least, 1.0)
    left = float(np.sqrt(max(chosen.fitted["total"] ** 2 - shaken**2, 0.0))) / max(gaps["fitted"]["total"], 1e-9)
    excess = chosen.fit.chi**2 - expected
    slow = [
        min(s.share / share, s.size / size) for s, share, size in zip(chosen.slow, SLOW_LEFT, SLOW_SIZE, strict=True)
    ]
    unlike = max(min(left / LEFT, excess / EXCESS), min(left / MOST_LEFT, rest / UNEXPLAINED), *slow, 0.0)
    close = _close(chosen, least, most)
    rivals = _rivals(chosen, named, close)
    temperature = close / 6.0
    probability = _probability(named, chosen, temperature)
    probability = {key: p / (1.0 + unlike**2) for key, p in probability.items()}
    verdict = _verdict(chosen, rivals, unlike)
    return Weighed(verdict, chosen, rivals, probability, tuple(labels), rest, left, unlike)


def _smallest(named: Sequence[Judged], least: float, most: float, threshold: float) -> Judged:
    """The smallest set of causes that no larger one beats by enough to matter."""
    sizes = sorted({len(j.causes) for j in named})
    chosen = next(j for j in named if len(j.causes) == sizes[0])
    for size in sizes[1:]:
        larger = next(j for j in named if len(j.causes) == size)
        gained = chosen.evidence - larger.evidence
        if gained <= _close(larger, least, most):
            continue
        shrunk = max(_less(chosen.fitted, larger.fitted), _less(chosen.held, larger.held))
        if shrunk >= WORTHWHILE * threshold or gained >= WORTHWHILE_SHARE * (most - larger.evidence):
            chosen = larger
    return chosen


def _close(chosen: Judged, least: float, most: float) -> float:
    """How much worse a rival may be that can't be excluded."""
    unexplained, explained = max(chosen.evidence - least, 0.0), max(most - chosen.evidence, 0.0)
    return CLOSE + CLOSE_LEFT * unexplained + CLOSE_EXPLAINED * explained


def _simplest(named: Sequence[Judged], chosen: Judged, close: float) -> Judged:
    """Of the sets that can't be told apart the one with the fewest free numbers comes first."""

    def worth(j: Judged) -> float:
        return j.evidence + close / 3.0 * sum(len(s.free) for s in j.fit.suspects if s.key in j.causes)

    same = [j for j in named if len(j.causes) == len(chosen.causes) and j.evidence - chosen.evidence <= close]
    return min(same, key=worth)


def _less(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """By how much the largest gap shrank, in quadrature."""
    return float(np.sqrt(max(largest(before) ** 2 - largest(after) ** 2, 0.0)))


def _rivals(chosen: Judged, named: Sequence[Judged], close: float) -> dict[Key, tuple[Key, ...]]:
    """For each cause those that could stand in its place: sets of the same size that differ in it alone."""
    out: dict[Key, list[Key]] = {key: [] for key in chosen.causes}
    for other in named:
        if other is chosen or other.evidence - chosen.evidence > close or len(other.causes) != len(chosen.causes):
            continue
        gone, come = set(chosen.causes) - set(other.causes), set(other.causes) - set(chosen.causes)
        if len(gone) == 1 and len(come) == 1:
            out[gone.pop()].append(come.pop())
    return {key: tuple(keys) for key, keys in out.items()}


def _probability(named: Sequence[Judged], chosen: Judged, temperature: float) -> dict[Key, float]:
    """Of each cause being present: the weights of all sets that hold it."""
    # Sets that are larger than the chosen one are no better for it: they were found not to matter.
    rivals = [j for j in named if j is chosen or len(j.causes) <= len(chosen.causes)]
    evidence = np.array([j.evidence for j in rivals])
    weights = np.exp(-0.5 * np.clip((evidence - chosen.evidence) / temperature, 0.0, 500.0))
    weights /= weights.sum()
    out: dict[Key, float] = {}
    for j, w in zip(rivals, weights, strict=True):
        for key in j.causes:
            out[key] = out.get(key, 0.0) + float(w)
    return out


def _verdict(chosen: Judged, rivals: Mapping[Key, tuple[Key, ...]], unlike: float) -> Verdict:
    if unlike > 1.0:
        return "outside_catalogue"
    if not chosen.causes:
        return "underdetermined"
    if max(len(keys) for keys in rivals.values()) >= CROWD:
        return "underdetermined"
    return "ambiguous" if any(rivals.values()) else "effect"
