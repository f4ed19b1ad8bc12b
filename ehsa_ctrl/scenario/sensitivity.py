"""Sensitivity of a scenario's verdict to the plant's parameters: each assumed one at both ends of its range, and the
parameters that decide pass or fail in a Monte Carlo campaign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError, SimulationError
from ..core.parameter import Parameter
from ..plant.file import label

if TYPE_CHECKING:
    from .montecarlo import Outcome
    from .prepare import PreparedScenario

#: With fewer passing or failing runs the two-sample test says nothing; the rank correlation with the margin is used.
FEWEST = 5
#: A parameter is decisive below this p-value, after correction for the number of parameters.
SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class RangeEnd:
    """The scenario with one assumed parameter at one end of its range.

    value: of the parameter, SI unit. metrics: on the nonlinear plant, SI units; empty where the run failed.
    failures: violated limits of scenario and plant, in sentences; baselines are not compared.
    """

    value: float
    metrics: Mapping[str, float]
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not self.failures


@dataclass(frozen=True)
class AssumptionSensitivity:
    """Effect of one assumed parameter on a scenario over the parameter's range.

    parameter: as in the plant's file. low, high: the scenario at the ends of the range.
    nominal_passed: whether the limits hold at the nominal value.
    """

    parameter: Parameter
    low: RangeEnd
    high: RangeEnd
    nominal_passed: bool

    @property
    def ends(self) -> tuple[RangeEnd, RangeEnd]:
        return self.low, self.high

    @property
    def flips(self) -> bool:
        """Whether the verdict at an end differs from the nominal one."""
        return any(end.passed != self.nominal_passed for end in self.ends)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for results.json, SI units."""
        return {
            "name": self.parameter.name,
            "value": self.parameter.value,
            "unit": self.parameter.unit,
            "file_unit": self.parameter.file_unit,
            "ends": [
                {"value": e.value, "metrics": dict(e.metrics), "passed": e.passed, "failures": list(e.failures)}
                for e in self.ends
            ],
            "flips": self.flips,
            "kept": self.nominal_passed,
        }


def assumption_sensitivity(case: PreparedScenario, nominal_passed: bool) -> tuple[AssumptionSensitivity, ...]:
    """Run a scenario with each assumed parameter at both ends of its range, one parameter at a time.

    The controller keeps its design for the nominal values, as it would on the rig. Parameters that were set for this
    run, and those without bounds in the file, are left out. `monte_carlo` covers combinations of parameters.

    nominal_passed: whether the limits of scenario and plant hold at the nominal values.
    """
    plant = case.nonlinear
    return tuple(
        AssumptionSensitivity(p, _range_end(case, name, p.lower), _range_end(case, name, p.upper), nominal_passed)
        for name, p in plant.parameters.items()
        if p.source == "assumed" and isfinite(p.lower) and isfinite(p.upper)
    )


def _range_end(case: PreparedScenario, name: str, value: float) -> RangeEnd:
    try:
        found = case.evaluate(case.simulate(case.nonlinear.set(**{name: value})))
    except (InputError, SimulationError) as error:
        return RangeEnd(value, {}, (str(error),))
    return RangeEnd(value, found.metrics, found.failures)


@dataclass(frozen=True)
class Influence:
    """Relation of one parameter to passing.

    Attributes
    ----------
    measure: "ks", the distance (0 to 1) between the parameter's distributions in passing and failing runs, or "rank",
        its rank correlation (-1 to 1) with the margin, where too few runs pass or fail.
    chance: p-value times the number of parameters (Bonferroni).
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
        return self.chance < SIGNIFICANCE

    def to_dict(self) -> dict[str, Any]:
        return vars(self) | {"decisive": self.decisive}

    def __str__(self) -> str:
        name = label(self.name)
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
    """Influence of every parameter on passing, the strongest first.

    Monte Carlo filtering (R. C. Spear, G. M. Hornberger, Water Research 14, 1980; A. Saltelli and others, "Global
    Sensitivity Analysis: The Primer", Wiley 2008): runs are split into passing and failing ones, and a parameter
    matters if its two distributions differ by the two-sample test of Kolmogorov and Smirnov.
    """
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
    corrected = [replace(i, chance=min(i.chance * len(names), 1.0)) for i in found]
    return tuple(sorted(corrected, key=lambda influence: -abs(influence.value)))
