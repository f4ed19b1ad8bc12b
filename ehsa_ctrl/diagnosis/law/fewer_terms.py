"""Laws with fewer terms than the best one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..pool import Pool
from ..scoring import ScoredHypothesis
from .free_run import refit_laws
from .tried import LawData, TriedLaw, as_long_as_better


def with_fewer_terms(tried: Sequence[TriedLaw], last: ScoredHypothesis, data: LawData, pool: Pool) -> list[TriedLaw]:
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
        refitted = refit_laws([law for _, law in pairs], data.scoring, best.base.fit, pool, others)
        return [replace(best, law=law) for law in refitted]

    return as_long_as_better(tried, last, data.reference, fewer)
