"""Model selection: the set of causes, its alternatives, the probability of each cause, and when to abstain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .diagnosis import Verdict
from .scoring import CauseKey, ScoredHypothesis, Scoring, by_label
from .signals import largest

#: An alternative can't be excluded within this deviance, plus this share of what the best model leaves unexplained,
#: plus this share of what it explains.
CLOSE, CLOSE_LEFT, CLOSE_EXPLAINED = 12.0, 0.3, 0.004
#: One more cause has to lower a gap by this share of the threshold (in quadrature), or the deviance by this share.
WORTHWHILE, WORTHWHILE_SHARE = 0.5, 0.02
#: No set of causes is right where the best one leaves this share of the gap on the training data, and residuals whose
#: mean square exceeds noise by this much; or most of the gap and this share of the deviance.
LEFT, EXCESS = 0.25, 0.3
MOST_LEFT, UNEXPLAINED = 0.5, 0.06
#: Nor where it leaves this share of the slow error, and more of it than noise and the assumed model error of a sample,
#: on training and on held-out data, where errors accumulate further.
SLOW_LEFT, SLOW_SIZE = (0.06, 0.35), (0.8, 1.0)
#: With this many alternatives the log does not excite what would tell them apart.
TOO_MANY = 4


@dataclass(frozen=True)
class Selection:
    """The selected model.

    chosen: the hypothesis. alternatives: cause -> those that could take its place. probability: of each cause of any
    hypothesis, being present. ranked: the best hypothesis of each set of causes, best first. misfit: above one, no
    effect of the catalogue explains the log.
    """

    verdict: Verdict
    chosen: ScoredHypothesis
    alternatives: Mapping[CauseKey, tuple[CauseKey, ...]]
    probability: Mapping[CauseKey, float]
    ranked: tuple[ScoredHypothesis, ...]
    misfit: float

    @property
    def named(self) -> bool:
        """Whether the verdict names the chosen causes."""
        return self.verdict in ("effect", "ambiguous")


@dataclass(frozen=True)
class Reference:
    """What the scores are compared with.

    noise, nominal: deviance of noise alone and of the nominal model. fitted: total gap of the nominal model on the
    training data. noise_square: mean square of residuals that are noise. input_noise: gap that the noise of the logged
    current makes.
    """

    noise: float
    nominal: float
    fitted: float
    noise_square: float
    input_noise: float = 0.0

    @classmethod
    def of(cls, scoring: Scoring) -> Reference:
        fitted = scoring.training.gap({})["total"]
        # A model that is off by more than the signals themselves is no worse than one that does not move at all.
        noise = scoring.noise_deviance
        nominal = noise + (scoring.nominal_deviance - noise) / max(fitted, 1.0) ** 2
        return cls(noise, nominal, fitted, scoring.noise_square, scoring.input_noise[0].gap)

    def unexplained(self, one: ScoredHypothesis) -> float:
        return max(one.deviance - self.noise, 0.0)

    def close(self, one: ScoredHypothesis) -> float:
        """How much larger the deviance of an alternative may be that can't be excluded."""
        return CLOSE + CLOSE_LEFT * self.unexplained(one) + CLOSE_EXPLAINED * max(self.nominal - one.deviance, 0.0)


def select_model(scores: Sequence[ScoredHypothesis], reference: Reference, threshold: float) -> Selection:
    """Choose among scored hypotheses."""
    ranked = sorted(by_label(scores).values(), key=lambda one: one.deviance)
    with_causes = [one for one in ranked if one.causes] or ranked
    chosen = _smallest(with_causes, reference, threshold)
    chosen = _simplest(with_causes, chosen, reference.close(chosen))
    misfit = _misfit(chosen, reference)
    close = reference.close(chosen)
    alternatives = _alternatives(chosen, with_causes, close)
    probability = _probability(with_causes, chosen, close / 6.0)
    probability = {key: p / (1.0 + misfit**2) for key, p in probability.items()}
    return Selection(_verdict(chosen, alternatives, misfit), chosen, alternatives, probability, tuple(ranked), misfit)


def _smallest(ranked: Sequence[ScoredHypothesis], reference: Reference, threshold: float) -> ScoredHypothesis:
    """The smallest set of causes that no larger one improves on by enough to matter."""
    sizes = sorted({len(one.causes) for one in ranked})
    chosen = next(one for one in ranked if len(one.causes) == sizes[0])
    for size in sizes[1:]:
        larger = next(one for one in ranked if len(one.causes) == size)
        gained = chosen.deviance - larger.deviance
        if gained <= reference.close(larger):
            continue
        decrease = max(
            _decrease(before, after)
            for before, after in ((chosen.fitted, larger.fitted), (chosen.held_out, larger.held_out))
        )
        if decrease >= WORTHWHILE * threshold or gained >= WORTHWHILE_SHARE * (reference.nominal - larger.deviance):
            chosen = larger
    return chosen


def _simplest(ranked: Sequence[ScoredHypothesis], chosen: ScoredHypothesis, close: float) -> ScoredHypothesis:
    """Of the sets that can't be told apart the one with the fewest free numbers comes first."""

    def penalised(one: ScoredHypothesis) -> float:
        return one.deviance + close / 3.0 * sum(len(c.free) for c in one.fit.candidates if c.key in one.causes)

    alike = [o for o in ranked if len(o.causes) == len(chosen.causes) and o.deviance - chosen.deviance <= close]
    return min(alike, key=penalised)


def _misfit(chosen: ScoredHypothesis, reference: Reference) -> float:
    rest = reference.unexplained(chosen) / max(reference.nominal - reference.noise, 1.0)
    gap_left = float(np.sqrt(max(chosen.fitted["total"] ** 2 - reference.input_noise**2, 0.0)))
    left = gap_left / max(reference.fitted, 1e-9)
    excess = chosen.fit.rms**2 - reference.noise_square
    slow = (min(s.share / a, s.size / b) for s, a, b in zip(chosen.slow, SLOW_LEFT, SLOW_SIZE, strict=True))
    return max(min(left / LEFT, excess / EXCESS), min(left / MOST_LEFT, rest / UNEXPLAINED), *slow, 0.0)


def _decrease(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """By how much the largest gap decreased, in quadrature."""
    return float(np.sqrt(max(largest(before) ** 2 - largest(after) ** 2, 0.0)))


def _alternatives(
    chosen: ScoredHypothesis, ranked: Sequence[ScoredHypothesis], close: float
) -> dict[CauseKey, tuple[CauseKey, ...]]:
    """For each cause those that could take its place: sets of the same size that differ in it alone."""
    out: dict[CauseKey, list[CauseKey]] = {key: [] for key in chosen.causes}
    for other in ranked:
        if other is chosen or other.deviance - chosen.deviance > close or len(other.causes) != len(chosen.causes):
            continue
        removed, added = set(chosen.causes) - set(other.causes), set(other.causes) - set(chosen.causes)
        if len(removed) == 1 and len(added) == 1:
            out[removed.pop()].append(added.pop())
    return {key: tuple(keys) for key, keys in out.items()}


def _probability(
    ranked: Sequence[ScoredHypothesis], chosen: ScoredHypothesis, temperature: float
) -> dict[CauseKey, float]:
    """Of each cause being present: the weights of all sets that contain it."""
    # Larger sets than the chosen one don't count: what they add was found not to matter.
    counted = [one for one in ranked if one is chosen or len(one.causes) <= len(chosen.causes)]
    deviance = np.array([one.deviance for one in counted])
    weights = np.exp(-0.5 * np.clip((deviance - chosen.deviance) / temperature, 0.0, 500.0))
    weights /= weights.sum()
    out: dict[CauseKey, float] = {}
    for one, w in zip(counted, weights, strict=True):
        for key in one.causes:
            out[key] = out.get(key, 0.0) + float(w)
    return out


def _verdict(chosen: ScoredHypothesis, alternatives: Mapping[CauseKey, tuple[CauseKey, ...]], misfit: float) -> Verdict:
    if misfit > 1.0:
        return "outside_catalogue"
    if not chosen.causes or max(len(keys) for keys in alternatives.values()) >= TOO_MANY:
        return "underdetermined"
    return "ambiguous" if any(alternatives.values()) else "effect"
