"""The verdict: how much of the gap the selected causes explain, measured by what matters.

A good log shows model errors that no user would care about. What the selected model leaves is therefore compared with
the threshold, with the log's own floor, and with what a free curve at the same place reaches on held-out data; its
statistical significance (the misfit of the selection) only says where that comparison is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..core.text import join_words
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from .diagnosis import Verdict
from .free_curve import BETTER, CurveLog, FreeCurve, free_curve
from .model_selection import Reference, Selection, selection_of
from .regimes import describe_curve
from .scoring import CauseKey, ScoredHypothesis
from .signals import largest

#: Causes are part of the explanation if they close this part of the gap, on training and on held-out data. An effect is
#: certain among many causes if every set without it explains less by this part, or closes less by it where the causes
#: close half of the gap, and if it makes half of the largest cause's gap. On two tuning seeds with an effect that the
#: catalogue lacks, the one that came nearest had 0.30 with 0.34 closed, and 0.43 with 0.46 of the largest gap; on the
#: records of a servo the latter is 0.50 to 1.
PART, HALF = 1.0 / 3.0, 0.5
#: Where the causes close MOST of the gap, this smaller part is enough if both measures have it. With as much closed,
#: effects beside one that the catalogue lacks had at most 0.14 on the tuning seeds, and friction under load 0.24 on
#: eight records of a servo together.
MOST, SMALL_PART = 0.6, 0.2
#: Where more than noise is left, so many causes may leave up to the threshold, and more causes this share of it; only
#: so few are claimed as part of a cause. On the tuning seeds of benchmarks/withheld sets of four to six causes closed
#: 0.34 to 0.84 of the gaps of effects that the catalogue lacks, and left 0.9 of the threshold or more.
FEW, MANY_LEFT = 3, 0.85
#: From so many thresholds on, what is left matters however small it is beside the nominal gap. Engineering judgement:
#: with a nominal gap of 2000 %, causes that close 97 % of it leave more than most rigs show at all.
MUCH_LEFT = 3.0
#: A part is claimed of the smallest set that closes this share of what the selected one closes, if less than SMALL_PART
#: of the deviance is lost with it: where all sets leave more than noise, a deviance counts what no cause explains. On a
#: measured record eight causes were selected, and four of them closed the same 97 %.
AS_MUCH = 0.98


@dataclass(frozen=True)
class Explanation:
    """What the selected causes explain.

    verdict: final. left: largest gap of a signal beyond the floor. curve: the best free curve beside the causes; None
    where the causes explain the log down to its noise, and no curve was tried.
    """

    verdict: Verdict
    left: float
    curve: FreeCurve | None = None

    @property
    def rest(self) -> str | None:
        """The free curve in words, where it is clearly better than the causes alone."""
        if self.curve is None or not self.curve.better:
            return None
        return join_words(describe_curve(curve) for curve in self.curve.curves)


def explain(
    selection: Selection,
    reference: Reference,
    threshold: float,
    logs: Sequence[CurveLog],
) -> Explanation:
    """The verdict on a selection.

    logs: with the plant that has the selected causes.
    """
    left = reference.left(selection.chosen)
    shares = reference.closed(selection.chosen)
    # What is closed of a gap that the best possible model may leave too is chance.
    above = [gap > floor.get("total", 0.0) for gap, floor in zip(reference.nominal_gaps, reference.floors, strict=True)]
    enough = all(share >= PART for share, counts in zip(shares, above, strict=True) if counts)
    # The robust loss gives spikes little weight: they may be all that is left, and all that there was.
    if selection.misfit <= 1.0 and left < (MUCH_LEFT if enough else 1.0) * threshold:
        return Explanation(selection.verdict, left)
    curve = free_curve(logs)
    # Several wrong numbers together imitate an unknown effect: they have to leave less.
    simple = len(selection.chosen.causes) <= FEW
    limit = threshold if simple else MANY_LEFT * threshold
    closed = min(shares)
    little = left < limit and enough and not (curve is not None and curve.better)
    # Many sets close a gap that is no larger than the floor: whether one of them acts is seen in the deviance alone.
    if little and (all(above) or not reference.leaves_much(selection.chosen)):
        return Explanation(selection.verdict, left, curve)
    named = selection.verdict in ("effect", "ambiguous")
    partly = simple and named and closed >= PART and not little
    return Explanation("partly" if partly else "outside_catalogue", left, curve)


def claimable_part(selection: Selection, reference: Reference) -> Selection | None:
    """What may be claimed of a selection that does not explain the log; None if nothing may.

    The certain effects among its causes, or among those of a smaller set that closes as much, if it closes PART of the
    gap; its other causes stay in the model as numbers that go with them. A set that fits the training data best may do
    worse on held-out data: then the same of the set of at most FEW causes that closes most of the gap, among those that
    can't be excluded.
    """
    chosen, closed = selection.chosen, reference.closed(selection.chosen)
    if min(closed) < PART:
        limit = chosen.deviance + reference.margin(chosen)
        few = [one for one in selection.ranked if len(one.causes) <= FEW and one.deviance <= limit]
        chosen = max(few, key=lambda one: min(reference.closed(one)), default=chosen)
    else:

        def closes_as_much(one: ScoredHypothesis) -> bool:
            shares = zip(reference.closed(one), closed, strict=True)
            return all(own >= max(AS_MUCH * share, PART) for own, share in shares)

        alike = [one for one in selection.ranked if one.causes and closes_as_much(one)]
        alike = [one for one in alike if _lost(one.deviance, selection.chosen, reference) < SMALL_PART]
        chosen = min([chosen, *alike], key=lambda one: len(one.causes))
    if chosen is not selection.chosen:
        selection = selection_of(chosen, selection.ranked, reference)
    certain = tuple(key for key in chosen.causes if _certain(key, selection, reference))
    if min(reference.closed(chosen)) < PART or not 0 < len(certain) <= FEW:
        return None
    return replace(selection, chosen=replace(chosen, causes=certain))


def _certain(key: CauseKey, selection: Selection, reference: Reference) -> bool:
    """Whether a cause is an effect that no other set of causes can do without, see PART.

    Sets are compared by their deviance, and by what they close on training and on held-out data: a form with many free
    numbers may follow the one and not the other. Large numbers that cancel each other imitate an effect. A set that
    needs more causes to do clearly worse is no rival.
    """
    chosen = selection.chosen
    gaps = {cause: largest(chosen.own_gaps[cause]) for cause in chosen.causes}
    without = [one for one in selection.ranked if key not in one.causes and not _needless(one, chosen, reference)]
    lost = _lost(min((one.deviance for one in without), default=reference.nominal), chosen, reference)
    closed = min(reference.closed(chosen))
    certain = lost >= PART
    if closed >= HALF:
        unclosed = 1.0 - max([0.0, *(min(reference.closed(one)) for one in without)]) / closed
        certain = max(lost, unclosed) >= PART or (closed >= MOST and min(lost, unclosed) >= SMALL_PART)
    return EFFECTS[key[0]].wired and certain and gaps[key] >= HALF * max(gaps.values())


def _needless(one: ScoredHypothesis, chosen: ScoredHypothesis, reference: Reference) -> bool:
    """Whether a set has more causes than the chosen one and is clearly worse: it lacks SMALL_PART of what the chosen
    one explains, and leaves clearly more gap on training and on held-out data.

    Where nearly all is closed, what is left tells more than what is closed. On a measured record six causes without
    free air left two and four times what four causes with it did, and lacked a third of what these explained.
    """
    more = len(one.causes) > len(chosen.causes) and _lost(one.deviance, chosen, reference) >= SMALL_PART
    pairs = zip(reference.closed(chosen), reference.closed(one), strict=True)
    return more and all(1.0 - own < BETTER * (1.0 - other) for own, other in pairs)


def _lost(deviance: float, chosen: ScoredHypothesis, reference: Reference) -> float:
    """Share that a hypothesis with this deviance lacks of what the chosen one explains."""
    return (deviance - chosen.deviance) / max(reference.nominal - chosen.deviance, 1e-9)


def only_parameters(causes: Sequence[CauseKey], plant: Plant) -> bool:
    """Whether causes are numbers that the nominal plant has, wrong, and more than one."""
    own = plant.structure.system.own

    def is_number(key: CauseKey) -> bool:
        symbols = [own(s) for s in EFFECTS[key[0]].symbols if own(s) in plant.parameters]
        return key[1] is None and any(plant[name] != 0.0 for name in symbols)

    return len(causes) > 1 and all(map(is_number, causes))
