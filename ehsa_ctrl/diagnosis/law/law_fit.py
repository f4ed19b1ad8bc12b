"""A law as it was found from an unknown input: a sum of terms with its factors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .grammar import Grammar, Term

#: A contact moves from this share of its highest speed on; share of these samples in which its friction may drive it.
#: Engineering judgement.
MOVES, DRIVEN = 0.02, 0.02


@dataclass(frozen=True)
class LawFit:
    """A sum of terms with its factors.

    explained: share of what errors of the nominal parameters leave of the unknown input's square, by cross-validation,
    less the penalty. factors, sd: of the terms, in the unknown input's unit over the term's.
    """

    grammar: Grammar
    terms: tuple[Term, ...]
    factors: tuple[float, ...]
    sd: tuple[float, ...]
    explained: float

    @property
    def numbers(self) -> int:
        """Number of free numbers."""
        return len(self.terms) + sum(len(term.shapes) for term in self.terms)

    @property
    def families(self) -> tuple[str, ...]:
        """What is the same in sums that differ in their numbers alone."""
        return tuple(sorted(term.family for term in self.terms))

    @property
    def with_one_term_less(self) -> list[LawFit]:
        """The same sum without each of its terms; nothing for a single one."""
        if len(self.terms) == 1:
            return []
        rows = list(zip(self.terms, self.factors, self.sd, strict=True))
        columns = [zip(*(row for row in rows if row is not out), strict=True) for out in rows]
        return [replace(self, terms=terms, factors=factors, sd=sd) for terms, factors, sd in columns]

    @property
    def is_wave(self) -> bool:
        """Whether it has a wave over the shaft angle."""
        return any(term.is_wave for term in self.terms)

    @property
    def with_whole_orders(self) -> LawFit | None:
        """The same sum with waves that meet again after a turn, where their order is nearly whole; None without one.

        A fitted order is a little off, and a wave over hundreds of turns out of phase at their end.
        """
        terms = tuple(term.with_whole_order for term in self.terms)
        return None if terms == self.terms else replace(self, terms=terms)

    @property
    def dissipates(self) -> bool:
        """Whether its friction, together with that of the plant, opposes the motion."""
        grammar = self.grammar
        if grammar.speed is None:
            return True
        pairs = zip(self.factors, self.terms, strict=True)
        parts = [f * grammar.values(t) for f, t in pairs if grammar.is_friction(t)]
        if not parts:
            return True
        moves = grammar.known[grammar.direction] * grammar.speed > MOVES * np.max(np.abs(grammar.speed))
        effort = grammar.resists * np.asarray(sum(parts)) + grammar.friction
        power = (effort * grammar.speed)[moves]
        return float(np.mean(power < 0.0)) <= DRIVEN

    @property
    def values(self) -> np.ndarray:
        """(N - 1,) along the logs."""
        parts = [f * self.grammar.values(t) for f, t in zip(self.factors, self.terms, strict=True)]
        return np.asarray(sum(parts) + np.zeros(self.grammar.samples))
