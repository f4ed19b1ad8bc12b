"""Find the law behind what the causes of a diagnosis leave."""

from __future__ import annotations

from dataclasses import replace

from ..hypothesis_search import Hypotheses
from ..model_selection import Reference, Selection
from ..pool import Pool
from ..records import Segment
from ..refit import HypothesisFit, refit
from ..scoring import ScoredHypothesis, Scoring
from .beside import with_fewer_effects, with_sensor_errors
from .fewer_terms import with_fewer_terms
from .found import FoundLaw, best_law
from .free_run import RENEW, STEPS, refit_laws, screen_laws
from .inputs import LawInput
from .judgement import is_beaten
from .law_fit import LawFit
from .promising import beyond_chance, promising, reduced, refitted_over_windows, with_explained
from .regression import find_sums, placebo
from .sum_problem import all_terms
from .tried import BaseOf, LawBase, TriedLaw

# The numbers below are engineering judgement.

#: Most laws that are refitted in free run.
MOST = 6
#: A law is refitted if it leaves, as it was found, less than the threshold or than so many times what is left without a
#: law: one of a regression, and one of a standstill, whose factor is only where a refit may start. On the bench true
#: laws left 0.05 to 0.7 times that, and one 2.2 times, of a tenth of the threshold. On records of a servo those of a
#: standstill left 1.3 to 4 times that, and a fifth to three quarters of it once they were refitted.
FAR, FAR_HELD = 2.0, 8.0
#: More causes than these may imitate a law however little they leave above noise.
FEW = 2


def find_law(
    hypotheses: Hypotheses,
    selection: Selection | None,
    base_of: BaseOf,
    scoring: Scoring,
    reference: Reference,
    screened: Segment,
) -> FoundLaw | None:
    """The law that closes most of what the causes of a selection leave; None where none is clearly better than them.

    Where effects are named beside the unknown one, they may be its image: the plant without them is tried too, and the
    law that is found without each of them. selection: None for the nominal plant alone. screened: data on which laws
    are simulated before any refit, all training data or a stretch of them.
    """
    pool, scoring = hypotheses.pool, with_typical_priors(scoring)
    screening = replace(scoring, training=screened)
    named = [selection.chosen.fit] if selection is not None and selection.has_causes else []
    bases = [base_of(fit) for fit in (hypotheses.fits[()], *named)]
    without = pool.map("laws", lambda base: without_law(base.fit, scoring), bases)
    most = MOST // len(bases)
    left = min(screened.gap(one.fit.values)["total"] for one in without)
    pairs = zip(bases, without, strict=True)
    tried = [one for base, own in pairs for one in _try(base, own, scoring, screening, most, left, pool)]
    tried = with_fewer_effects(tried, without[-1], base_of, scoring, reference, pool)
    tried = with_sensor_errors(tried, without[-1], hypotheses.candidates, base_of, scoring, reference, pool)
    tried = with_fewer_terms(tried, without[-1], scoring, reference, pool)
    if selection is not None and not named:
        effects = scoring.score(selection.chosen.fit)
        tried = [one for one in tried if not is_beaten(one.law.scored, effects, reference)]
    return best_law(tried, without[-1], reference)


def law_is_sought(selection: Selection, reference: Reference) -> bool:
    """Whether the catalogue does not explain the gap, or only with causes that may imitate a law."""
    if not selection.explains:
        return True
    chosen = selection.chosen
    # No law is ahead by the margin of causes that leave less than that.
    many = len(chosen.causes) > FEW and reference.unexplained(chosen) > reference.margin(chosen)
    return selection.has_causes and (many or reference.leaves_much(chosen))


def with_typical_priors(scoring: Scoring) -> Scoring:
    """Nominal parameters as uncertain as on a typical rig: with narrow priors a law makes up for a wrong one."""
    objective = scoring.objective
    nominal = replace(objective.nominal, sd=objective.nominal.typical)
    return replace(scoring, objective=replace(objective, nominal=nominal))


def without_law(fit: HypothesisFit, scoring: Scoring) -> ScoredHypothesis:
    """The hypothesis without a law, as it is or with all nominal parameters refitted: what leaves less."""
    refitted = refit(scoring.objective, fit.candidates, fit.values, {}, steps=STEPS, renew_after=RENEW)
    scored = [scoring.score(one) for one in (fit, refitted) if one is not None]
    return min(scored, key=lambda one: one.held_out_gap["total"])


def _try(
    base: LawBase,
    without: ScoredHypothesis,
    scoring: Scoring,
    screening: Scoring,
    most: int,
    left: float,
    pool: Pool,
) -> list[TriedLaw]:
    """The most promising laws beside a hypothesis, in free run. without: the hypothesis without a law. screening: the
    scoring on the data for screening. left: smallest gap that a hypothesis without a law leaves on these.
    """
    inputs = base.inputs(scoring.objective.nominal)
    found = pool.map("laws", _sums, inputs, lambda one: one.windows.values.size)
    placebos = {one.name: share for one, (_, share) in zip(inputs, found, strict=True)}
    sums = [one for fits, share in found for one in beyond_chance(fits, share)]
    held = with_explained([law for one in inputs for law in one.held], inputs)
    valves = with_explained([law for one in inputs for law in one.valves], inputs)
    far, far_held = (max(scoring.threshold, times * left) for times in (FAR, FAR_HELD))
    chosen = screen_laws(held, screening, base.fit, pool, far_held)
    chosen += promising([*sums, *valves], screening, base.fit, most, far, pool)
    by_name = {one.name: one for one in reversed(inputs)}
    refitted = refit_laws(chosen, scoring, base.fit, pool)
    refitted += refitted_over_windows(sums, chosen, scoring, base.fit, without, pool)
    refitted += refit_laws(reduced(refitted, inputs), scoring, base.fit, pool)
    limits = [(law, one.others) for one in refitted if (law := one.proportional) is not None]
    linear = with_explained([law for law, _ in limits], inputs)
    refitted += refit_laws(linear, scoring, base.fit, pool, [others for _, others in limits])
    return [
        TriedLaw(one, base, without, by_name[one.law.grammar.name], placebos[one.law.grammar.name]) for one in refitted
    ]


def _sums(one: LawInput) -> tuple[list[LawFit], float]:
    """The best sums for an unknown input, and the share that the placebo explains."""
    problem = all_terms(one.grammar, one.windows, one.nuisance)
    return find_sums(problem), placebo(problem)
