"""Find the law behind what the causes of a diagnosis leave.

In a long log, laws are searched on stretches of it, and the best one, with the forms that these can't tell from it, is
refitted to all training data and judged on all data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..hypothesis_search import Hypotheses
from ..model_selection import Reference, Selection
from ..pool import Pool
from ..refit import HypothesisFit, fit_on, refit
from ..scoring import ScoredHypothesis, Scoring
from .beside import refitted_to_all_data, with_fewer_effects, with_sensor_errors
from .fewer_terms import with_fewer_terms
from .found import FoundLaw, best_law
from .free_run import RENEW, STEPS, refit_laws, screen_laws
from .inputs import LawInput
from .judgement import is_beaten
from .law_fit import LawFit
from .promising import beyond_chance, promising, reduced, refitted_over_windows, with_explained
from .regression import find_sums, placebo
from .sum_problem import all_terms
from .tried import LawBase, LawData, TriedLaw, laws_of_best

# The numbers below are engineering judgement.

#: Most laws that are refitted in free run.
MOST = 6
#: A law is refitted if it leaves, as it was found, less than the threshold or than so many times what is left without a
#: law: one of a regression, and one of a standstill, whose factor is only where a refit may start. On the bench true
#: laws left 0.05 to 0.7 times that, and one 2.2 times, of a tenth of the threshold. On records of a servo those of a
#: standstill left 1.3 to 4 times that, and a fifth to three quarters of it once they were refitted.
FAR, FAR_HELD = 2.0, 8.0
#: Most places whose laws are refitted to all data, one after the other: those of the best may hold on a stretch only.
MOVED = 2
#: More causes than these may imitate a law however little they leave above noise.
FEW = 2


def find_law(
    hypotheses: Hypotheses, selection: Selection | None, data: LawData, stretch: LawData | None = None
) -> FoundLaw | None:
    """The law that closes most of what the causes of a selection leave; None where none is clearly better than them.

    Where effects are named beside the unknown one, they may be its image: the plant without them is tried too, and the
    law that is found without each of them. selection: None for the nominal plant alone. stretch: of a long log.
    """
    named = [selection.chosen.fit] if selection is not None and selection.has_causes else []
    fits = [hypotheses.fits[()], *named]
    effects = selection.chosen.fit if selection is not None and not named else None
    data = with_typical_priors(data)
    moved: list[HypothesisFit] = []
    if stretch is not None:
        stretch = with_typical_priors(stretch)
        moved = [one for fit in fits if (one := fit_on(stretch.scoring.objective, fit)) is not None]
    if stretch is None or len(moved) < len(fits):
        tried, last = _search(hypotheses, fits, data)
        return _best(tried, last, effects, data)
    found, last = _search(hypotheses, moved, stretch)
    on_all: ScoredHypothesis | None = None
    for _ in range(MOVED):
        alike = laws_of_best(found, last, stretch.reference)
        if not alike:
            break
        on_all = on_all or without_law(fits[-1], data.scoring)
        law = _best(refitted_to_all_data(alike, stretch, data, hypotheses.pool), on_all, effects, data)
        if law is not None:
            return law
        base, place = alike[0].base, alike[0].law.law.grammar.name
        found = [one for one in found if one.base is not base or one.law.law.grammar.name != place]
    return None


def _best(
    tried: Sequence[TriedLaw], last: ScoredHypothesis, effects: HypothesisFit | None, data: LawData
) -> FoundLaw | None:
    """The best law, unless effects of which none may be named clearly beat it. last: as in `laws_of_best`."""
    if tried and effects is not None:
        scored = data.scoring.score(effects)
        tried = [one for one in tried if not is_beaten(one.law.scored, scored, data.reference)]
    return best_law(tried, last, data.reference)


def _search(
    hypotheses: Hypotheses, fits: Sequence[HypothesisFit], data: LawData
) -> tuple[list[TriedLaw], ScoredHypothesis]:
    """Laws beside each of these fits in free run, and the last fit without a law."""
    pool, scoring = hypotheses.pool, data.scoring
    bases = [data.base_of(fit) for fit in fits]
    without = pool.map("laws", lambda base: without_law(base.fit, scoring), bases)
    last, most = without[-1], MOST // len(bases)
    left = min(scoring.training.gap(one.fit.values)["total"] for one in without)
    pairs = zip(bases, without, strict=True)
    tried = [one for base, own in pairs for one in _try(base, own, scoring, most, left, pool)]
    tried = with_fewer_effects(tried, last, data, pool)
    tried = with_sensor_errors(tried, last, hypotheses.candidates, data, pool)
    return with_fewer_terms(tried, last, data, pool), last


def law_is_sought(selection: Selection, reference: Reference) -> bool:
    """Whether the catalogue does not explain the gap, or only with causes that may imitate a law."""
    if not selection.explains:
        return True
    chosen = selection.chosen
    # No law is ahead by the margin of causes that leave less than that.
    many = len(chosen.causes) > FEW and reference.unexplained(chosen) > reference.margin(chosen)
    return selection.has_causes and (many or reference.leaves_much(chosen))


def with_typical_priors(data: LawData) -> LawData:
    """Nominal parameters as uncertain as on a typical rig: with narrow priors a law makes up for a wrong one."""
    objective = data.scoring.objective
    nominal = replace(objective.nominal, sd=objective.nominal.typical)
    return replace(data, scoring=replace(data.scoring, objective=replace(objective, nominal=nominal)))


def without_law(fit: HypothesisFit, scoring: Scoring) -> ScoredHypothesis:
    """The hypothesis without a law, as it is or with all nominal parameters refitted: what leaves less."""
    refitted = refit(scoring.objective, fit.candidates, fit.values, {}, steps=STEPS, renew_after=RENEW)
    scored = [scoring.score(one) for one in (fit, refitted) if one is not None]
    return min(scored, key=lambda one: one.held_out_gap["total"])


def _try(
    base: LawBase,
    without: ScoredHypothesis,
    scoring: Scoring,
    most: int,
    left: float,
    pool: Pool,
) -> list[TriedLaw]:
    """The most promising laws beside a hypothesis, in free run.

    without: the hypothesis without a law. left: smallest gap that a hypothesis without a law leaves on the training
    data.
    """
    inputs = base.inputs(scoring.objective.nominal)
    found = pool.map("laws", _sums, inputs, lambda one: one.windows.values.size)
    placebos = {one.name: share for one, (_, share) in zip(inputs, found, strict=True)}
    sums = [one for fits, share in found for one in beyond_chance(fits, share)]
    held = with_explained([law for one in inputs for law in one.held], inputs)
    valves = with_explained([law for one in inputs for law in one.valves], inputs)
    far, far_held = (max(scoring.threshold, times * left) for times in (FAR, FAR_HELD))
    chosen = screen_laws(held, scoring, base.fit, pool, far_held)
    chosen += promising([*sums, *valves], scoring, base.fit, most, far, pool)
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
