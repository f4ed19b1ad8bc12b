"""Model selection: the set of causes, its alternatives, the probability of each cause, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .diagnosis import NAMING, Verdict
from .scoring import CauseKey, ScoredHypothesis, Scoring, floor_of, rank
from .signals import largest_beyond

# The thresholds were chosen with the tuning seeds of the independent bench; docs/evidence.md has results with others.

#: An alternative can't be excluded if its deviance is larger by less than the margin: a constant (12 is a likelihood
#: ratio of 400), plus a share of the deviance that the best model leaves above noise, plus a share of what it explains.
MARGIN, MARGIN_UNEXPLAINED, MARGIN_EXPLAINED = 12.0, 0.3, 0.004
#: An additional cause must lower the deviance by more than the margin with this share in place of MARGIN_EXPLAINED.
MARGIN_ADDED = 0.003
#: A gap that falls by this share of the threshold (in quadrature) falls by a relevant amount.
MIN_DECREASE = 0.5
#: A set dominates another one if it has no more causes and leaves less than this share of its gap, on training and on
#: held-out data, and both are smaller by MIN_DECREASE. The robust loss alone might prefer the other one: it gives
#: little weight to large errors in a few blocks, since these may be slips that the simulation missed.
DOMINATED = 1.0 / 3.0
#: The catalogue does not explain the log if the best set leaves this share of the training gap and residuals whose mean
#: square exceeds that of noise by EXCESS;
LEFT, EXCESS = 0.25, 0.3
#: or if it leaves this share of the training gap and this share of the deviance above noise;
MOST_LEFT, UNEXPLAINED = 0.5, 0.06
#: or if it leaves this share of the low-frequency error and at least this RMS of it, in units of noise and assumed
#: model error. First on training, then on held-out data, where errors accumulate.
LOW_FREQUENCY_LEFT, LOW_FREQUENCY_RMS = (0.06, 0.35), (0.8, 1.0)
#: Causes that leave this share of the nominal deviance above noise may imitate a law that the catalogue lacks. On
#: tuning seeds with a rig's errors causes of the catalogue left at most 0.05 of it, those in place of an effect that it
#: lacks 0.14 or more in 23 of 24 logs.
IMITATED = 0.1
#: Number of alternatives to one cause from which on the verdict is "underdetermined".
TOO_MANY = 4


@dataclass(frozen=True)
class Selection:
    """The selected hypothesis.

    alternatives: cause -> causes that could replace it. probability: cause of any hypothesis -> probability that it is
    present. ranked: the best hypothesis of each set of causes, the lowest deviance first. misfit: what the chosen
    hypothesis leaves, relative to the thresholds above; above 1, no effect of the catalogue explains the log.
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
        return self.verdict in NAMING

    @property
    def has_causes(self) -> bool:
        """Whether the verdict gives the chosen causes, by name or as candidates among others."""
        return bool(self.chosen.causes) and self.verdict != "outside_catalogue"

    @property
    def explains(self) -> bool:
        """Whether the verdict says that the chosen causes explain the gap."""
        return self.verdict not in ("outside_catalogue", "partly")


@dataclass(frozen=True)
class Reference:
    """Reference values for scores.

    noise, nominal: deviance of noise alone and of the nominal model. training_gap: total gap of the nominal model on
    training data. noise_square: mean square of residuals due to noise. floors: gap that the best possible model leaves
    on training and on held-out data. nominal_gaps: total gap of the nominal model on both. threshold: smallest relevant
    gap.
    """

    noise: float
    nominal: float
    training_gap: float
    noise_square: float
    floors: tuple[Mapping[str, float], Mapping[str, float]] = ({}, {})
    nominal_gaps: tuple[float, float] = (1.0, 1.0)
    threshold: float = 0.03

    @classmethod
    def of(cls, scoring: Scoring) -> Reference:
        training_gap = scoring.training.gap({})["total"]
        noise, nominal = scoring.noise_deviance, scoring.nominal_deviance
        segments = scoring.training, scoring.held_out
        floors = [floor_of(segment, one.gaps) for segment, one in zip(segments, scoring.input_noise, strict=True)]
        gaps = training_gap, scoring.held_out.gap({})["total"]
        return cls(noise, nominal, training_gap, scoring.noise_square, (floors[0], floors[1]), gaps, scoring.threshold)

    @property
    def capped_nominal(self) -> float:
        """Deviance of the nominal model. A gap above 1 counts as 1: that of a model which does not move at all."""
        return self.noise + (self.nominal - self.noise) / max(self.training_gap, 1.0) ** 2

    def unexplained(self, one: ScoredHypothesis) -> float:
        """Deviance above that of noise."""
        return max(one.deviance - self.noise, 0.0)

    def unexplained_share(self, one: ScoredHypothesis) -> float:
        """The same as a share of that of the nominal model."""
        return self.unexplained(one) / max(self.capped_nominal - self.noise, 1.0)

    def leaves_much(self, one: ScoredHypothesis) -> bool:
        """Whether a hypothesis leaves so much of the deviance that something beside its causes has to act."""
        return self.unexplained_share(one) > IMITATED

    def closed(self, one: ScoredHypothesis) -> tuple[float, float]:
        """Share of the nominal gap in total that a hypothesis closes on training and held-out data."""
        after = one.training_gap["total"], one.held_out_gap["total"]
        shares = [1.0 - gap / max(before, 1e-12) for gap, before in zip(after, self.nominal_gaps, strict=True)]
        return shares[0], shares[1]

    def left(self, one: ScoredHypothesis) -> float:
        """The largest gap of a signal beyond the floor that a hypothesis leaves on training or held-out data."""
        pairs = zip((one.training_gap, one.held_out_gap), self.floors, strict=True)
        return max(largest_beyond(gaps, floor) for gaps, floor in pairs)

    def beyond_floor(self, one: ScoredHypothesis) -> tuple[float, float]:
        """Gap in total on training and held-out data, with the floor of each subtracted in quadrature."""
        pairs = zip((one.training_gap, one.held_out_gap), self.floors, strict=True)
        found = [max(gaps["total"] ** 2 - floor.get("total", 0.0) ** 2, 0.0) ** 0.5 for gaps, floor in pairs]
        return found[0], found[1]

    def is_relevant(
        self, before: Mapping[str, float], after: Mapping[str, float], floor: Mapping[str, float] | None = None
    ) -> bool:
        """Whether the largest gap, beyond the floor if one is given, falls by a relevant amount, see MIN_DECREASE."""
        first, last = (largest_beyond(gaps, floor or {}) for gaps in (before, after))
        return first**2 - last**2 >= (MIN_DECREASE * self.threshold) ** 2

    def margin(self, one: ScoredHypothesis, share: float = MARGIN_EXPLAINED) -> float:
        """Alternatives whose deviance is larger by at most this margin can't be excluded."""
        explained = max(self.capped_nominal - one.deviance, 0.0)
        return MARGIN + MARGIN_UNEXPLAINED * self.unexplained(one) + share * explained


def select_model(scores: Sequence[ScoredHypothesis], reference: Reference) -> Selection:
    """Select the causes from scored hypotheses."""
    ranked = rank(scores)
    with_causes = _with_causes(ranked)
    chosen = _select_smallest(with_causes, reference)
    chosen = _select_simplest(with_causes, chosen, reference.margin(chosen))
    while better := [one for one in with_causes if dominates(one, chosen, reference)]:
        chosen = better[0]
    return selection_of(chosen, ranked, reference)


def selection_of(chosen: ScoredHypothesis, ranked: Sequence[ScoredHypothesis], reference: Reference) -> Selection:
    """The selection of a hypothesis among others, the best of each set of causes first.

    Sets that it dominates are no alternatives, and have no probability.
    """
    with_causes = _with_causes([one for one in ranked if not dominates(chosen, one, reference)])
    alternatives = _alternatives(chosen, with_causes, reference.margin(chosen))
    probability = _probability(with_causes, chosen, reference)
    verdict = _verdict(chosen, alternatives)
    return Selection(verdict, chosen, alternatives, probability, tuple(ranked), _misfit(chosen, reference))


def _with_causes(ranked: Sequence[ScoredHypothesis]) -> Sequence[ScoredHypothesis]:
    """The hypotheses with causes; all if none has any."""
    return [one for one in ranked if one.causes] or ranked


def dominates(one: ScoredHypothesis, other: ScoredHypothesis, reference: Reference) -> bool:
    """Whether a hypothesis leaves a much smaller gap than another one, with no more causes; see DOMINATED."""
    pairs = (other.training_gap, one.training_gap), (other.held_out_gap, one.held_out_gap)
    return 0 < len(one.causes) <= len(other.causes) and all(
        after["total"] < DOMINATED * before["total"] and reference.is_relevant(before, after) for before, after in pairs
    )


def _select_smallest(ranked: Sequence[ScoredHypothesis], reference: Reference) -> ScoredHypothesis:
    """The smallest set of causes that no larger set improves on by a relevant amount."""
    best: dict[int, ScoredHypothesis] = {}
    for one in ranked:
        best.setdefault(len(one.causes), one)
    by_size = [best[size] for size in sorted(best)]
    return next(
        one
        for i, one in enumerate(by_size)
        if not any(_improves(larger, one, reference) for larger in by_size[i + 1 :])
    )


def _improves(larger: ScoredHypothesis, one: ScoredHypothesis, reference: Reference) -> bool:
    """Whether a larger set of causes is better by a relevant amount, see MARGIN_ADDED."""
    return one.deviance - larger.deviance > reference.margin(larger, MARGIN_ADDED)


def _select_simplest(ranked: Sequence[ScoredHypothesis], chosen: ScoredHypothesis, margin: float) -> ScoredHypothesis:
    """Of the sets of the same size within the margin, that with the lowest deviance plus a penalty per parameter."""

    def penalised(one: ScoredHypothesis) -> float:
        return one.deviance + margin / 3.0 * sum(len(c.free) for c in one.fit.candidates if c.key in one.causes)

    alike = [o for o in ranked if len(o.causes) == len(chosen.causes) and o.deviance - chosen.deviance <= margin]
    return min(alike, key=penalised)


def _misfit(chosen: ScoredHypothesis, reference: Reference) -> float:
    """See `Selection.misfit`."""
    left = reference.beyond_floor(chosen)[0] / max(reference.training_gap, 1e-9)
    excess = chosen.fit.rms**2 - reference.noise_square
    low_frequency = (
        min(s.share / a, s.rms / b)
        for s, a, b in zip(chosen.low_frequency_errors, LOW_FREQUENCY_LEFT, LOW_FREQUENCY_RMS, strict=True)
    )
    unexplained = reference.unexplained_share(chosen)
    return max(min(left / LEFT, excess / EXCESS), min(left / MOST_LEFT, unexplained / UNEXPLAINED), *low_frequency, 0.0)


def _alternatives(
    chosen: ScoredHypothesis, ranked: Sequence[ScoredHypothesis], margin: float
) -> dict[CauseKey, tuple[CauseKey, ...]]:
    """Cause -> causes that could replace it, from sets within the margin that differ in this cause only."""
    out: dict[CauseKey, list[CauseKey]] = {key: [] for key in chosen.causes}
    for other in ranked:
        if other is chosen or other.deviance - chosen.deviance > margin or len(other.causes) != len(chosen.causes):
            continue
        removed, added = set(chosen.causes) - set(other.causes), set(other.causes) - set(chosen.causes)
        if len(removed) == 1 and len(added) == 1:
            out[removed.pop()].append(added.pop())
    return {key: tuple(keys) for key, keys in out.items()}


def relative_weights(scored: Sequence[ScoredHypothesis], best: ScoredHypothesis, reference: Reference) -> np.ndarray:
    """Weights (n,) exp(-deviance / 2) of hypotheses with the sum 1.

    A temperature divides the deviance, because the model error makes it larger than that of independent noise.
    """
    deviance = np.array([one.deviance for one in scored])
    temperature = reference.margin(best) / 6.0
    weights = np.exp(-0.5 * np.clip((deviance - best.deviance) / temperature, 0.0, 500.0))
    return np.asarray(weights / weights.sum())


def _probability(
    ranked: Sequence[ScoredHypothesis], chosen: ScoredHypothesis, reference: Reference
) -> dict[CauseKey, float]:
    """Cause -> probability that it is present: the sum of the weights of all sets that contain it."""
    # Sets larger than the chosen one are left out: what they add was found to be irrelevant.
    counted = [one for one in ranked if one is chosen or len(one.causes) <= len(chosen.causes)]
    out: dict[CauseKey, float] = {}
    for one, w in zip(counted, relative_weights(counted, chosen, reference), strict=True):
        for key in one.causes:
            out[key] = out.get(key, 0.0) + float(w)
    return out


def _verdict(chosen: ScoredHypothesis, alternatives: Mapping[CauseKey, tuple[CauseKey, ...]]) -> Verdict:
    """The verdict if the chosen causes explain the gap."""
    if not chosen.causes or max(len(keys) for keys in alternatives.values()) >= TOO_MANY:
        return "underdetermined"
    return "ambiguous" if any(alternatives.values()) else "effect"
