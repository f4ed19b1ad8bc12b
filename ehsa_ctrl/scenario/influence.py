"""Which uncertain parameter decides whether a scenario passes.

Monte Carlo filtering (R. C. Spear, G. M. Hornberger, Water Research 14, 1980; A. Saltelli and others, "Global
Sensitivity Analysis: The Primer", Wiley 2008): the runs are parted into those that pass and those that fail, and a
parameter matters if its two distributions differ, which the two-sample test of Kolmogorov and Smirnov measures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..plant.file import both
from .campaign import Outcome

#: Fewer runs than this on one side say nothing; the margin's rank correlation is looked at instead.
FEWEST = 5
#: A parameter is called decisive below this probability of chance, shared among all that were looked at.
CHANCE = 0.01


@dataclass(frozen=True)
class Influence:
    """What one parameter has to do with passing.

    Attributes
    ----------
    measure: "ks", the distance 0 to 1 of its distributions in runs that pass and in runs that fail, or "rank", the
        correlation -1 to 1 of its rank with that of the margin, where too few runs pass or fail.
    chance: probability of such a value if it had nothing to do with it, times the number of parameters.
    passing, failing: medians, SI units; nan with "rank".
    """

    name: str
    measure: str
    value: float
    chance: float
    passing: float
    failing: float

    @property
    def decisive(self) -> bool:
        return self.chance < CHANCE

    def to_dict(self) -> dict[str, Any]:
        return vars(self) | {"decisive": self.decisive}

    def __str__(self) -> str:
        name = both(self.name)
        if not self.decisive:
            return f"no parameter decides it: the nearest is {name} (probability of chance {self.chance:.2g})"
        if self.measure == "ks":
            side = "high" if self.failing > self.passing else "low"
            return (
                f"{name} decides it: runs fail where it is {side} (median {self.failing:.4g}, {self.passing:.4g} "
                f"where they pass; Kolmogorov-Smirnov distance {self.value:.2f})"
            )
        way = "grows" if self.value > 0 else "falls"
        return f"{name} matters most: the least margin {way} with it (rank correlation {self.value:.2f})"


def influences(outcomes: Sequence[Outcome], names: Sequence[str]) -> tuple[Influence, ...]:
    """Every parameter's influence on passing, the strongest first."""
    from scipy.stats import ks_2samp, spearmanr

    passed = np.array([outcome.passed for outcome in outcomes], dtype=bool)
    margin = np.array([outcome.margin for outcome in outcomes])
    enough = min(np.count_nonzero(passed), np.count_nonzero(~passed)) >= FEWEST
    found = []
    for name in names:
        values = np.array([outcome.parameters[name] for outcome in outcomes])
        if enough:
            test = ks_2samp(values[passed], values[~passed])
            medians = float(np.median(values[passed])), float(np.median(values[~passed]))
            found.append(Influence(name, "ks", float(test.statistic), float(test.pvalue), *medians))
        elif len(values) >= FEWEST and np.ptp(values) > 0 and np.unique(margin).size > 1:
            rank = spearmanr(values, margin)
            found.append(Influence(name, "rank", float(rank.statistic), float(rank.pvalue), np.nan, np.nan))
    several = [
        Influence(i.name, i.measure, i.value, min(i.chance * len(names), 1.0), i.passing, i.failing) for i in found
    ]
    return tuple(sorted(several, key=lambda influence: -abs(influence.value)))
