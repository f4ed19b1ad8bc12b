"""How much of an unknown input sums of terms explain: fits with cross-validation, and a block bootstrap of the factors.

Unknown input and terms are averaged over short windows (`regimes.Windows`), and each sum is validated on the intervals
that it was not fitted to. Errors of the nominal parameters are further columns under their priors: a wrong inertia adds
an acceleration to an unknown torque, which is no law.

Source: S. N. Lahiri, "Resampling Methods for Dependent Data", 2003 (block bootstrap).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..regimes import Windows
from .grammar import Grammar, Term
from .law_fit import LawFit

# The numbers below are engineering judgement.

#: Penalty on each number of a law, as a share of the unknown input's square.
PENALTY = 0.002
#: Variance that is left to chance, as a share of the unknown input's square, when it is weighed against the priors of
#: the nominal parameters. Windows overlap, so that only one in OVERLAP counts.
CHANCE, OVERLAP = 0.05, 4.0
#: Length of a block [s] and resamples of the bootstrap.
BLOCK, RESAMPLES = 1.0, 100
#: Ridge on the factors of the terms, relative to the mean square of their columns.
RIDGE = 1e-6


@dataclass(frozen=True)
class SumTarget:
    """What sums explain: an unknown input over windows, from which errors of the nominal parameters are eliminated.

    grammar: of the terms. windows: of the unknown input. nuisance: (windows, p) change of the unknown input by one
    prior deviation of each nominal parameter, averaged over the same windows. What follows from them alone is computed
    once for thousands of sums.
    """

    grammar: Grammar
    windows: Windows
    nuisance: np.ndarray = field(repr=False)

    @property
    def values(self) -> np.ndarray:
        """(windows,) of the unknown input."""
        return self.windows.values

    @cached_property
    def prior(self) -> float:
        """Weight of the priors of the nominal parameters against the squares."""
        return OVERLAP * CHANCE * float(np.mean(self.values**2)) + 1e-12

    @cached_property
    def folds(self) -> tuple[_Fold, ...]:
        """Each half of the intervals for the test of a fit to the other half."""
        return tuple(_Fold(self, test) for test in (0, 1))

    @cached_property
    def blocks(self) -> list[slice]:
        """The windows of each block of the bootstrap."""
        _, first = np.unique((self.windows.centres // BLOCK).astype(int), return_index=True)
        return [slice(one, end) for one, end in zip(first, [*first[1:], self.values.size], strict=True)]

    def column(self, term: Term) -> np.ndarray:
        """(windows,) means of a term."""
        span = self.windows.span
        return self.windows.over_span(self.grammar.values(term, span) * np.ones(span.stop - span.start))

    def reversed(self) -> SumTarget:
        """The unknown input reversed in time."""
        return replace(self, windows=self.windows.reversed())


class _Fold:
    """Elimination of the errors of the nominal parameters, fitted to one half of the intervals, tested on the other.

    With a (p,) these errors, their prior deviations as units, and L the weight of the prior,
    a = (P P' + L)^-1 P (y - C b) for any factors b of columns C; P (p, windows) is `target.nuisance`, transposed. With
    P P' + L = M M', M^-1 P on either half does for all columns what the fit and the test of a need.
    """

    def __init__(self, target: SumTarget, test: int) -> None:
        self.target = target
        self.fit, self.test = (np.flatnonzero(target.windows.fold == one) for one in (1 - test, test))
        fitted = target.nuisance[self.fit]
        M = np.linalg.cholesky(fitted.T @ fitted + target.prior * np.eye(fitted.shape[1]))
        self.fitted = np.ascontiguousarray(np.linalg.solve(M, fitted.T))
        self.tested = np.ascontiguousarray(np.linalg.solve(M, target.nuisance[self.test].T).T)

    def of(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns (windows, k): on the windows for the fit, their elimination (p, k), and what remains for the test."""
        fit = columns[self.fit]
        error = self.fitted @ fit
        return fit, error, columns[self.test] - self.tested @ error

    @cached_property
    def values(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same of the unknown input (windows, 1)."""
        return self.of(self.target.values[:, None])


class _FoldTerms:
    """Normal equations of the terms on one fold: G b = g for their factors b, and the products T, t, square of what
    remains of terms and unknown input on the test.

    Of the terms' products with each other, only those with a few chosen ones are needed, and the squares.
    """

    def __init__(self, fold: _Fold, C: np.ndarray) -> None:
        """C: (windows, m) columns of the terms."""
        self._fit, self._error, self._left = fold.of(C)
        self._rows: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._set_target(fold)

    def _set_target(self, fold: _Fold) -> None:
        fit, error, left = fold.values
        self.g = (self._fit.T @ fit - self._error.T @ error)[:, 0]
        self.t = (self._left.T @ left)[:, 0]
        self.square = float((left.T @ left)[0, 0])

    def of_other(self, fold: _Fold) -> _FoldTerms:
        """The same terms for another unknown input over the same windows, with the same mean square."""
        other = copy(self)
        other._set_target(fold)
        return other

    @cached_property
    def squares(self) -> tuple[np.ndarray, np.ndarray]:
        """(m,) diagonals of G and T."""
        of_fit, of_error, of_left = (np.einsum("ij,ij->j", one, one) for one in (self._fit, self._error, self._left))
        return of_fit - of_error, of_left

    def rows(self, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """(k, m) rows of G and T of the chosen terms."""
        new = [i for i in dict.fromkeys(chosen) if i not in self._rows]
        if new:
            G = self._fit[:, new].T @ self._fit - self._error[:, new].T @ self._error
            self._rows |= zip(new, zip(G, self._left[:, new].T @ self._left, strict=True), strict=True)
        found = [self._rows[i] for i in chosen]
        shape = len(chosen), self.g.size
        return np.array([G for G, _ in found]).reshape(shape), np.array([T for _, T in found]).reshape(shape)


@dataclass(frozen=True)
class SumProblem:
    """All terms with their normal equations on each fold, so that thousands of sums cost little.

    terms: those with a column that is not zero. C: (windows, m) their columns, divided by `scales`.
    """

    target: SumTarget
    terms: Sequence[Term]
    scales: np.ndarray
    C: np.ndarray = field(repr=False)
    folds: Sequence[_FoldTerms] = field(repr=False)

    @classmethod
    def of_columns(cls, target: SumTarget, terms: Sequence[Term], columns: Sequence[np.ndarray]) -> SumProblem:
        """columns: (windows,) of each term, with any scale."""
        C = np.column_stack(columns) if len(columns) else np.zeros((target.values.size, 0))
        scales = np.sqrt(np.mean(C**2, axis=0))
        kept = np.isfinite(scales) & (scales > 0.0)
        C = C[:, kept] / scales[kept]
        of = [term for term, one in zip(terms, kept, strict=True) if one]
        return cls(target, of, scales[kept], C, [_FoldTerms(fold, C) for fold in target.folds])

    @classmethod
    def of(cls, target: SumTarget, terms: Sequence[Term]) -> SumProblem:
        return cls.of_columns(target, terms, [target.column(term) for term in terms])

    def reversed(self) -> SumProblem:
        """The same terms for the unknown input reversed in time."""
        target = self.target.reversed()
        pairs = zip(self.folds, target.folds, strict=True)
        return replace(self, target=target, folds=[one.of_other(fold) for one, fold in pairs])

    @cached_property
    def numbers(self) -> np.ndarray:
        """(m,) free numbers of each term."""
        return np.array([1 + len(term.shapes) for term in self.terms], dtype=int)

    @property
    def ridge(self) -> float:
        return RIDGE * self.target.values.size + 1e-12

    @property
    def total(self) -> float:
        """Sum of squares of the unknown input."""
        return float(self.target.values @ self.target.values)

    @cached_property
    def nuisance_left(self) -> float:
        """Sum of squares that errors of the nominal parameters leave."""
        return self.left(())

    def lefts(self, chosen: Sequence[int], further: Sequence[int]) -> np.ndarray:
        """(n,) sum of squares that the chosen terms leave with each further one, on the folds not fitted to."""
        of, others = list(chosen), np.array(further, dtype=int)
        k = len(of)
        found = np.zeros(others.size)
        for fold in self.folds:
            normal, left = (
                _bordered(rows[:, of], rows[:, others], diagonal[others])
                for rows, diagonal in zip(fold.rows(of), fold.squares, strict=True)
            )
            g, t = (np.column_stack([*np.tile(one[of], (others.size, 1)).T, one[others]]) for one in (fold.g, fold.t))
            b = np.linalg.solve(normal + self.ridge * np.eye(k + 1), g[:, :, None])[:, :, 0]
            found += fold.square - 2.0 * np.sum(b * t, axis=1) + np.einsum("ni,nij,nj->n", b, left, b)
        return found

    def left(self, chosen: Sequence[int]) -> float:
        """Sum of squares that one sum leaves, as `lefts`, which takes hundreds at a time."""
        of, found = list(chosen), 0.0
        for fold in self.folds:
            G, T = (rows[:, of] for rows in fold.rows(of))
            b = np.linalg.solve(G + self.ridge * np.eye(len(of)), fold.g[of])
            found += float(fold.square - 2.0 * b @ fold.t[of] + b @ T @ b)
        return found

    def explained(self, chosen: Sequence[int], further: Sequence[int]) -> np.ndarray:
        """(n,) share that the chosen terms explain with each further one, see `LawFit`."""
        numbers = self.numbers[list(chosen)].sum() + self.numbers[list(further)]
        return 1.0 - self.lefts(chosen, further) / max(self.nuisance_left, 1e-300) - PENALTY * numbers

    def share(self, chosen: Sequence[int]) -> float:
        """Share that one sum explains."""
        numbers = int(self.numbers[list(chosen)].sum())
        return 1.0 - self.left(chosen) / max(self.nuisance_left, 1e-300) - PENALTY * numbers

    @property
    def whole(self) -> float:
        """Share that all terms together explain."""
        return self.share(range(len(self.terms)))

    def factors(self, chosen: Sequence[int], counts: np.ndarray) -> np.ndarray:
        """Factors (n, k) of the terms, fitted to all windows with each of several weights (n, blocks)."""
        P, terms = self.target.nuisance, list(chosen)
        Z = np.column_stack([P, self.C[:, terms], self.target.values])
        products = np.stack([Z[one].T @ Z[one] for one in self.target.blocks])
        G = np.tensordot(counts, products, axes=1)
        prior = np.repeat([self.target.prior, self.ridge], [P.shape[1], len(terms)])
        b = np.linalg.solve(G[:, :-1, :-1] + np.diag(prior), G[:, :-1, -1:])[:, P.shape[1] :, 0]
        return np.asarray(b / self.scales[terms])

    def fit(self, chosen: Sequence[int], share: float) -> LawFit:
        """A sum with its factors and their standard deviations by the block bootstrap. share: that it explains."""
        random, blocks = np.random.default_rng(0), len(self.target.blocks)
        draws = [np.bincount(random.integers(0, blocks, blocks), minlength=blocks) for _ in range(RESAMPLES)]
        factors, *resampled = self.factors(chosen, np.vstack([np.ones(blocks), *draws]))
        terms = tuple(self.terms[i] for i in chosen)
        with np.errstate(over="ignore", invalid="ignore"):
            # A term that is almost zero along the log has a factor whose square overflows.
            sd = np.std(resampled, axis=0)
        return LawFit(self.target.grammar, terms, tuple(factors.tolist()), tuple(sd.tolist()), share)


def _bordered(block: np.ndarray, rows: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """(n, k + 1, k + 1) matrices with one block (k, k), each with a further row and column of `rows` (k, n)."""
    k, n = rows.shape
    found = np.empty((n, k + 1, k + 1))
    found[:, :k, :k] = block
    found[:, :k, k] = found[:, k, :k] = rows.T
    found[:, k, k] = diagonal
    return found


def all_terms(grammar: Grammar, windows: Windows, nuisance: np.ndarray) -> SumProblem:
    """All terms of a grammar, for an unknown input. windows, nuisance: see `SumTarget`."""
    return SumProblem.of(SumTarget(grammar, windows, nuisance), list(grammar.terms()))


def explained_by(fit: LawFit, windows: Windows, nuisance: np.ndarray) -> float:
    """Share of an unknown input that a sum's terms explain, see `LawFit`."""
    return SumProblem.of(SumTarget(fit.grammar, windows, nuisance), fit.terms).whole


def evidence(fit: LawFit, windows: Windows, nuisance: np.ndarray) -> float:
    """Logarithm of the probability of a sum's terms, given an unknown input, up to a constant: the likelihood by
    cross-validation, and a penalty on each number as in the Bayesian information criterion.

    One block of the bootstrap counts as one sample, because errors of the balances are correlated within it.
    """
    target = SumTarget(fit.grammar, windows, nuisance)
    problem = SumProblem.of(target, fit.terms)
    left = problem.left(range(len(problem.terms))) / max(problem.total, 1e-300)
    blocks = len(target.blocks)
    return -0.5 * float(blocks * np.log(max(left, 1e-12)) + fit.numbers * np.log(max(blocks, 2)))
