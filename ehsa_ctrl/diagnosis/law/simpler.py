"""Simpler laws than the best one: beside fewer effects, and with fewer terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from ...physics.effects import CandidateEffect
from ..model_selection import Reference
from ..pool import Pool
from ..refit import HypothesisFit, refit
from ..scoring import ScoredHypothesis, Scoring
from .free_run import RENEW, STEPS, refit_laws
from .promising import EACH, reduced
from .tried import LawBase, TriedLaw, laws_of_best


def with_fewer_effects(
    tried: Sequence[TriedLaw],
    last: ScoredHypothesis,
    base_of: Callable[[HypothesisFit], LawBase],
    scoring: Scoring,
    reference: Reference,
    pool: Pool,
) -> list[TriedLaw]:
    """Laws with the best of them beside one effect less, as long as that is better. last: as in `laws_of_best`.

    An effect may imitate a part of the law; another term of the law cancels it then. Laws that were found beside other
    effects are tried too: a constant leakage and a law that corrects it are far from a leakage that grows with time.
    """

    def fewer(tried: Sequence[TriedLaw], alike: Sequence[TriedLaw]) -> list[TriedLaw]:
        return [
            one
            for out in alike[0].base.fit.candidates
            for one in _without_effect(alike, found_elsewhere(tried, alike[0], out), out, base_of, scoring, pool)
        ]

    return _as_long_as_better(tried, last, reference, fewer)


def _as_long_as_better(
    tried: Sequence[TriedLaw],
    last: ScoredHypothesis,
    reference: Reference,
    smaller: Callable[[Sequence[TriedLaw], Sequence[TriedLaw]], list[TriedLaw]],
) -> list[TriedLaw]:
    """The laws with smaller ones than the best, as long as one of these becomes the best.

    smaller: laws tried, and those of the best -> further ones. last: as in `laws_of_best`.
    """
    tried = list(tried)
    alike = laws_of_best(tried, last, reference)
    better = bool(alike)
    while better:
        found = smaller(tried, alike)
        tried += found
        alike = laws_of_best(tried, last, reference)
        better = any(alike[0] is one for one in found)
    return tried


def found_elsewhere(tried: Sequence[TriedLaw], best: TriedLaw, out: CandidateEffect) -> list[TriedLaw]:
    """The best laws of the same unknown input that were found beside other effects, and without one of them."""
    found: dict[str, TriedLaw] = {}
    for one in sorted(tried, key=lambda one: one.law.scored.deviance):
        same_input = one.law.law.grammar.name == best.law.law.grammar.name
        if same_input and one.law.stable and out.key not in [c.key for c in one.base.fit.candidates]:
            found.setdefault(one.law.file.form, one)
    return list(found.values())[:EACH]


def _without_effect(
    alike: Sequence[TriedLaw],
    elsewhere: Sequence[TriedLaw],
    out: CandidateEffect,
    base_of: Callable[[HypothesisFit], LawBase],
    scoring: Scoring,
    pool: Pool,
) -> list[TriedLaw]:
    """Laws of the same unknown input beside the same effects, refitted without one of these.

    elsewhere: laws found beside other effects, which are tried here too.
    """
    best = alike[0]
    rest = tuple(c for c in best.base.fit.candidates if c is not out)
    values = best.base.fit.without(out, scoring.objective)
    fit = refit(scoring.objective, rest, values, {}, steps=STEPS, renew_after=RENEW)
    if fit is None:
        return []
    own = {name: best.law.others[name] for c in rest for name in c.names}
    kept = {*scoring.objective.nominal.names, *own}.difference(out.names)
    found = [one.law for one in (*alike, *elsewhere)]
    others = [own | {n: v for n, v in law.others.items() if n in kept} for law in found]
    laws = refit_laws([law.refitted for law in found], scoring, fit, pool, others)
    laws += refit_laws(reduced(laws, [best.input]), scoring, fit, pool)
    base, without = base_of(fit), scoring.score(fit)
    return [replace(best, law=law, base=base, without=without) for law in laws]


def with_fewer_terms(
    tried: Sequence[TriedLaw], last: ScoredHypothesis, scoring: Scoring, reference: Reference, pool: Pool
) -> list[TriedLaw]:
    """Laws with the best of them without one of its terms, as long as that is better. last: as in `laws_of_best`.

    The regression takes terms that its errors need, and a free run does not. The law of the lowest deviance is tried
    like that too, if it has more terms than the best: without what it does not need, it may be the best.
    """
    known: list[tuple[str, ...]] = []

    def fewer(tried: Sequence[TriedLaw], alike: Sequence[TriedLaw]) -> list[TriedLaw]:
        best = alike[0]
        name = best.law.law.grammar.name
        same = [one for one in tried if one.base is best.base and one.law.law.grammar.name == name and one.law.stable]
        lowest = min(same, key=lambda one: one.law.scored.deviance)
        pairs = []
        for of in [best, lowest] if lowest.terms > best.terms else [best]:
            for law in of.law.refitted.with_one_term_less:
                if law.families not in known:
                    known.append(law.families)
                    pairs.append((of, law))
        others = [of.law.others for of, _ in pairs]
        refitted = refit_laws([law for _, law in pairs], scoring, best.base.fit, pool, others)
        return [replace(best, law=law) for law in refitted]

    return _as_long_as_better(tried, last, reference, fewer)
