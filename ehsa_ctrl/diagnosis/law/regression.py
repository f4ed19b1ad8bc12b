"""Sums of terms that explain an unknown input: forward selection, and what it finds in chance.

Source: A. Miller, "Subset Selection in Regression", 2nd ed., 2002 (forward selection).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .grammar import variables_of
from .law_fit import LawFit
from .shapes import stable
from .sum_problem import SumProblem, SumTarget

# The numbers below are engineering judgement.

#: Most terms of a sum, and most variables.
MOST_TERMS, MOST_VARIABLES = 3, 2
#: Sums that are kept in each step of the selection, and in its result.
BEAM, KEPT = 6, 12
#: Smallest gain of a further term, as a share of the unknown input's square.
GAIN = 0.01
#: A term with a smaller gain is tried if it explains this share of what the others leave: a constant that is small
#: beside the unknown input moves a free run on and on.
OF_REST = 0.25
#: Sums whose difference is this share of their size are the same.
ALIKE = 0.01
#: Single terms of the same variables that leave up to so many times what the best of them leaves are all tried: beside
#: the filter of a sensor a hinge left 1.003 times what a parabola did, and in its place the cube of a pressure 1.8.
NEAR = 1.1


#: Explained share of a sum, and the indices of its terms.
RankedSum = tuple[float, tuple[int, ...]]


def find_sums(problem: SumProblem) -> list[LawFit]:
    """The best sums of terms for an unknown input, the one that explains most first.

    Waves of a nearly whole order come with that order too, see `with_whole_orders`.
    """
    everything = range(len(problem.terms))
    found = _selected(problem, everything)
    if found:
        # The pressures balance whatever acts on the rod, so that a law of them hides the others.
        first = variables_of([problem.terms[i] for i in max(found)[1]])
        found += _selected(problem, [i for i in everything if not problem.terms[i].variables & first])
    fits = [problem.fit(chosen, share) for share, chosen in _varied(problem, found)]
    return with_whole_orders(problem.target, _distinct(_all_stable(problem.target, fits)))


def with_whole_orders(target: SumTarget, fits: Sequence[LawFit]) -> list[LawFit]:
    """The sums, and behind them those of a nearly whole order with the whole one, in the phase that fits then."""
    whole = [other for one in fits if (other := one.with_whole_orders) is not None]
    return [*fits, *_all_stable(target, whole)]


def placebo(problem: SumProblem) -> float:
    """Share that a single term explains of the unknown input reversed in time, beyond a constant, which reversal leaves
    as it is: what the selection finds in chance."""
    other = problem.reversed()
    constant = [i for i, term in enumerate(other.terms) if not term.variables and term.text == "1"]
    beside = [i for i in range(len(other.terms)) if i not in constant]
    return float(other.explained(constant, beside).max()) - max(other.share(constant), 0.0) if beside else 0.0


def _all_stable(target: SumTarget, fits: Sequence[LawFit]) -> list[LawFit]:
    return [one for fit in fits if (one := stable(target, fit)) is not None]


def _distinct(fits: Sequence[LawFit]) -> list[LawFit]:
    """The sums that differ along the logs and whose friction does not drive, the one that explains most first."""
    distinct: list[LawFit] = []
    # Of single terms of the same variables -> what the best of them leaves.
    left: dict[frozenset[str], float] = {}
    for one in sorted(fits, key=lambda fit: -fit.explained):
        variables, rest = variables_of(one.terms), 1.0 - one.explained
        clear = len(one.terms) > 1 or rest <= NEAR * left.get(variables, np.inf)
        if one.dissipates and clear and not any(_alike(one, other) for other in distinct):
            distinct.append(one)
            if len(one.terms) == 1:
                left.setdefault(variables, rest)
    return distinct


def _selected(problem: SumProblem, allowed: Sequence[int]) -> list[RankedSum]:
    """The best sums of these terms, of each size."""
    beam: list[RankedSum] = [(0.0, ())]
    found: list[RankedSum] = []
    best = 0.0
    for _ in range(MOST_TERMS):
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


def _varied(problem: SumProblem, found: Sequence[RankedSum]) -> list[RankedSum]:
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
