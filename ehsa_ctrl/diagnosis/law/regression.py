"""Sums of terms that explain an unknown input: forward selection with cross-validation, and a block bootstrap.

Unknown input and terms are averaged over short windows (`regimes.Windows`), and each sum is validated on the intervals
that it was not fitted to. Errors of the nominal parameters are further columns under their priors: a wrong inertia adds
an acceleration to an unknown torque, which is no law.

Sources: A. Miller, "Subset Selection in Regression", 2nd ed., 2002 (forward selection); S. N. Lahiri, "Resampling
Methods for Dependent Data", 2003 (block bootstrap).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from ..regimes import Windows
from .grammar import Grammar, Term, variables_of

# The numbers below are engineering judgement.

#: Most terms of a sum, and most variables.
MOST_TERMS, MOST_VARIABLES = 3, 2
#: Sums that are kept in each step of the selection, and in its result.
BEAM, KEPT = 6, 12
#: Penalty on each number of a law, and smallest gain of a further term, as shares of the unknown input's square.
PENALTY, GAIN = 0.002, 0.01
#: A term with a smaller gain is tried if it explains this share of what the others leave: a constant that is small
#: beside the unknown input moves a free run on and on.
OF_REST = 0.25
#: Variance that is left to chance, as a share of the unknown input's square, when it is weighed against the priors of
#: the nominal parameters. Windows overlap, so that only one in OVERLAP counts.
CHANCE, OVERLAP = 0.05, 4.0
#: Length of a block [s] and resamples of the bootstrap; a term is unstable if its factor is smaller than so many of its
#: standard deviations.
BLOCK, RESAMPLES, STABLE = 1.0, 100, 2.0
#: Ridge on the factors of the terms, relative to the mean square of their columns.
RIDGE = 1e-6
#: Sums whose difference is this share of their size are the same.
ALIKE = 0.01
#: Single terms of the same variables that leave up to so many times what the best of them leaves are all tried: beside
#: the filter of a sensor a hinge left 1.003 times what a parabola did, and in its place the cube of a pressure 1.8.
NEAR = 1.1
#: A contact moves from this share of its highest speed on; share of these samples in which its friction may drive it.
MOVES, DRIVEN = 0.02, 0.02


#: Explained share of a sum, and the indices of its terms.
RankedSum = tuple[float, tuple[int, ...]]


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


@dataclass(frozen=True)
class _Target:
    """What sums explain: an unknown input over windows, from which errors of the nominal parameters are eliminated.

    nuisance: see `find_sums`. What follows from them alone is computed once for thousands of sums.
    """

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

    def column(self, grammar: Grammar, term: Term) -> np.ndarray:
        """(windows,) means of a term."""
        return self.windows.of((grammar.values(term) * np.ones(self.windows.size))[:, None])[:, 0]

    def reversed(self) -> _Target:
        """The unknown input reversed in time."""
        return _Target(self.windows.reversed(), self.nuisance)


class _Fold:
    """Elimination of the errors of the nominal parameters, fitted to one half of the intervals, tested on the other.

    With a (p,) these errors, their prior deviations as units, and L the weight of the prior,
    a = (P P' + L)^-1 P (y - C b) for any factors b of columns C; P (p, windows) is `target.nuisance`, transposed. With
    P P' + L = M M', M^-1 P on either half does for all columns what the fit and the test of a need.
    """

    def __init__(self, target: _Target, test: int) -> None:
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
class _SumProblem:
    """All terms with their normal equations on each fold, so that thousands of sums cost little.

    terms: those with a column that is not zero. C: (windows, m) their columns, divided by `scales`.
    """

    target: _Target
    terms: Sequence[Term]
    scales: np.ndarray
    C: np.ndarray = field(repr=False)
    folds: Sequence[_FoldTerms] = field(repr=False)

    @classmethod
    def of_columns(cls, target: _Target, terms: Sequence[Term], columns: Sequence[np.ndarray]) -> _SumProblem:
        """columns: (windows,) of each term, with any scale."""
        C = np.column_stack(columns) if len(columns) else np.zeros((target.values.size, 0))
        scales = np.sqrt(np.mean(C**2, axis=0))
        kept = np.isfinite(scales) & (scales > 0.0)
        C = C[:, kept] / scales[kept]
        of = [term for term, one in zip(terms, kept, strict=True) if one]
        return cls(target, of, scales[kept], C, [_FoldTerms(fold, C) for fold in target.folds])

    @classmethod
    def of(cls, grammar: Grammar, target: _Target, terms: Sequence[Term]) -> _SumProblem:
        return cls.of_columns(target, terms, [target.column(grammar, term) for term in terms])

    def reversed(self) -> _SumProblem:
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


def _bordered(block: np.ndarray, rows: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """(n, k + 1, k + 1) matrices with one block (k, k), each with a further row and column of `rows` (k, n)."""
    k, n = rows.shape
    found = np.empty((n, k + 1, k + 1))
    found[:, :k, :k] = block
    found[:, :k, k] = found[:, k, :k] = rows.T
    found[:, k, k] = diagonal
    return found


def sums_and_placebo(grammar: Grammar, windows: Windows, nuisance: np.ndarray) -> tuple[list[LawFit], float]:
    """`find_sums` and `placebo` of an unknown input. Waves of a nearly whole order come with that order too, behind the
    others, in the phase that fits then.
    """
    problem = _SumProblem.of(grammar, _Target(windows, nuisance), list(grammar.terms()))
    fits = _find_sums(problem, grammar, MOST_TERMS)
    whole = [one.with_whole_orders for one in fits]
    fits += [one for fit in whole if fit is not None and (one := _stable(grammar, problem.target, fit)) is not None]
    return fits, _placebo(problem)


def find_sums(grammar: Grammar, windows: Windows, nuisance: np.ndarray) -> list[LawFit]:
    """The best sums of terms for an unknown input, the one that explains most first.

    windows: of the unknown input. nuisance: (windows, p) change of the unknown input by one prior deviation of each
    nominal parameter, averaged over the same windows.
    """
    return sums_and_placebo(grammar, windows, nuisance)[0]


def placebo(grammar: Grammar, windows: Windows, nuisance: np.ndarray) -> float:
    """Share that a single term explains of the unknown input reversed in time, beyond a constant, which reversal leaves
    as it is: what the selection finds in chance."""
    return sums_and_placebo(grammar, windows, nuisance)[1]


def _placebo(problem: _SumProblem) -> float:
    other = problem.reversed()
    constant = [i for i, term in enumerate(other.terms) if not term.variables and term.text == "1"]
    beside = [i for i in range(len(other.terms)) if i not in constant]
    return float(other.explained(constant, beside).max()) - max(other.share(constant), 0.0) if beside else 0.0


def _find_sums(problem: _SumProblem, grammar: Grammar, most_terms: int) -> list[LawFit]:
    everything = range(len(problem.terms))
    found = _selected(problem, everything, most_terms)
    if found:
        # The pressures balance whatever acts on the rod, so that a law of them hides the others.
        first = variables_of([problem.terms[i] for i in max(found)[1]])
        found += _selected(problem, [i for i in everything if not problem.terms[i].variables & first], most_terms)
    fits = [_fit(problem, grammar, chosen, share) for share, chosen in _varied(problem, found)]
    stable = [one for one in (_stable(grammar, problem.target, fit) for fit in fits) if one is not None]
    distinct: list[LawFit] = []
    # Of single terms of the same variables -> what the best of them leaves.
    left: dict[frozenset[str], float] = {}
    for one in sorted(stable, key=lambda fit: -fit.explained):
        variables, rest = variables_of(one.terms), 1.0 - one.explained
        clear = len(one.terms) > 1 or rest <= NEAR * left.get(variables, np.inf)
        if one.dissipates and clear and not any(_alike(one, other) for other in distinct):
            distinct.append(one)
            if len(one.terms) == 1:
                left.setdefault(variables, rest)
    return distinct


def _selected(problem: _SumProblem, allowed: Sequence[int], most_terms: int) -> list[RankedSum]:
    """The best sums of these terms, of each size."""
    beam: list[RankedSum] = [(0.0, ())]
    found: list[RankedSum] = []
    best = 0.0
    for _ in range(most_terms):
        rows: dict[frozenset[str], RankedSum] = {}
        for before, chosen in beam:
            used = variables_of([problem.terms[i] for i in chosen])
            families = {problem.terms[i].family for i in chosen}
            fitting = [
                i
                for i in allowed
                if problem.terms[i].family not in families and len(used | problem.terms[i].variables) <= MOST_VARIABLES
            ]
            for i, share in zip(fitting, problem.explained(chosen, fitting).tolist(), strict=True):
                term = problem.terms[i]
                key = frozenset({*families, term.family})
                enough = min(GAIN, OF_REST * (1.0 - before))
                if share > before + enough and (key not in rows or share > rows[key][0]):
                    rows[key] = (share, (*chosen, i))
        beam = sorted(rows.values(), reverse=True)[:BEAM]
        if not beam or beam[0][0] < best + min(GAIN, OF_REST * (1.0 - best)):
            break
        best = beam[0][0]
        found += beam
    return found


def _varied(problem: _SumProblem, found: Sequence[RankedSum]) -> list[RankedSum]:
    """The best sums, and the best one of each size for each set of variables; of single terms, for each family.

    Small errors of the balances at high frequency are explained well, and hardly matter in free run. Of single terms of
    the same variables, the one that explains most is known once their shapes are fitted: on the grid, steps of a drive
    explained more of a brake's torque than the brake.
    """
    ranked = sorted(found, reverse=True)
    best: dict[tuple[int, frozenset[str], str], RankedSum] = {}
    for share, chosen in ranked:
        terms = [problem.terms[i] for i in chosen]
        family = terms[0].family if len(terms) == 1 else ""
        best.setdefault((len(terms), variables_of(terms), family), (share, chosen))
    return list(dict.fromkeys([*ranked[:3], *sorted(best.values(), reverse=True)]))[:KEPT]


def _alike(one: LawFit, other: LawFit) -> bool:
    """Whether two sums of the same variables are the same function along the logs; others differ in a simulation."""
    if variables_of(one.terms) != variables_of(other.terms):
        return False
    a, b = one.values, other.values
    return float(np.sum((a - b) ** 2)) < ALIKE**2 * float(np.sum(a**2) + np.sum(b**2))


def explained_by(fit: LawFit, windows: Windows, nuisance: np.ndarray) -> float:
    """Share of an unknown input that a sum's terms explain, see `LawFit`."""
    return _SumProblem.of(fit.grammar, _Target(windows, nuisance), fit.terms).whole


def evidence(fit: LawFit, windows: Windows, nuisance: np.ndarray) -> float:
    """Logarithm of the probability of a sum's terms, given an unknown input, up to a constant: the likelihood by
    cross-validation, and a penalty on each number as in the Bayesian information criterion.

    One block of the bootstrap counts as one sample, because errors of the balances are correlated within it.
    """
    target = _Target(windows, nuisance)
    problem = _SumProblem.of(fit.grammar, target, fit.terms)
    left = problem.left(range(len(problem.terms))) / max(problem.total, 1e-300)
    blocks = len(target.blocks)
    return -0.5 * float(blocks * np.log(max(left, 1e-12)) + fit.numbers * np.log(max(blocks, 2)))


def _fit(problem: _SumProblem, grammar: Grammar, chosen: tuple[int, ...], share: float) -> LawFit:
    """A sum with its factors and their standard deviations by the block bootstrap."""
    random, blocks = np.random.default_rng(0), len(problem.target.blocks)
    draws = [np.bincount(random.integers(0, blocks, blocks), minlength=blocks) for _ in range(RESAMPLES)]
    factors, *resampled = problem.factors(chosen, np.vstack([np.ones(blocks), *draws]))
    terms = tuple(problem.terms[i] for i in chosen)
    with np.errstate(over="ignore", invalid="ignore"):
        # A term that is almost zero along the log has a factor whose square overflows.
        sd = np.std(resampled, axis=0)
    return LawFit(grammar, terms, tuple(factors.tolist()), tuple(sd.tolist()), share)


def _stable(grammar: Grammar, target: _Target, fit: LawFit) -> LawFit | None:
    """The sum with its shapes off the grid and without unstable terms; None if none is left."""
    while True:
        sure = [abs(f) > STABLE * sd for f, sd in zip(fit.factors, fit.sd, strict=True)]
        terms = [term for term, one in zip(fit.terms, sure, strict=True) if one]
        if not terms:
            return None
        terms = _shaped(grammar, target, terms)
        problem = _SumProblem.of(grammar, target, terms)
        chosen = tuple(range(len(problem.terms)))
        found = _fit(problem, grammar, chosen, problem.whole)
        if not np.isfinite([*found.factors, *found.sd]).all():
            # A location that has left the data, where the term is almost zero.
            return None
        if all(sure):
            return found
        fit = found


def _scale(name: str, value: float, unit: str, whole: float) -> float:
    """Step of the search for a shape. whole: range of the variables of its term."""
    if name == "at":
        return 1.0 if unit == "1" else 0.1 * (whole if unit != "s" else value)
    return 0.05 * value if unit == "1" else abs(value)


def _is_positive(term: Term, name: str) -> bool:
    """Whether a shape is: all but locations other than times."""
    return name != "at" or term.units[name] == "s"


def _shaped(grammar: Grammar, target: _Target, terms: list[Term]) -> list[Term]:
    """Terms with the shapes that leave least, from those of the grid."""
    start = np.array([value for term in terms for value in term.shapes.values()])
    if start.size == 0:
        return terms
    reach = {v.text: float(np.ptp(v.values)) for v in grammar.variables}
    scale = []
    for term in terms:
        whole = max((reach[text] for text in term.variables if text in reach), default=0.0)
        scale += [_scale(name, value, term.units[name], whole) for name, value in term.shapes.items()]

    def moved(z: np.ndarray) -> list[Term]:
        given, out = iter((start + z * np.array(scale)).tolist()), []
        for term in terms:
            out.append(replace(term, shapes={name: next(given) for name in term.shapes}))
        return out

    fixed = {i: target.column(grammar, term) for i, term in enumerate(terms) if not term.shapes}

    def left(z: np.ndarray) -> float:
        shaped = moved(z)
        pairs = zip(shaped, terms, strict=True)
        # A step in time before the log begins is a constant.
        if any(new.shapes[n] <= 0.1 * old.shapes[n] for new, old in pairs for n in old.shapes if _is_positive(old, n)):
            return np.inf
        columns = [fixed[i] if i in fixed else target.column(grammar, term) for i, term in enumerate(shaped)]
        problem = _SumProblem.of_columns(target, shaped, columns)
        return problem.left(range(len(problem.terms))) if len(problem.terms) == len(terms) else np.inf

    first = np.vstack([np.zeros(start.size), 0.3 * np.eye(start.size)])
    options = {"maxiter": 40 * start.size, "initial_simplex": first, "xatol": 0.01, "fatol": 1e-4 * left(first[0])}
    return moved(minimize(left, first[0], method="Nelder-Mead", options=options).x)
