"""Sensitivity of a scenario's verdict to plant parameters.

Two analyses: each assumed parameter at both ends of its range, and the parameters that decide whether a run of a Monte
Carlo campaign passes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError, SimulationError
from ..core.parameter import Parameter
from ..core.result import as_dict
from ..plant.file import label

if TYPE_CHECKING:
    from .outcome import Outcome
    from .prepare import PreparedScenario

#: With fewer passing or failing runs, the rank correlation with the margin replaces the two-sample test, which has
#: hardly any power then (engineering judgement).
MIN_RUNS = 5
#: A parameter is decisive below this p-value (engineering judgement), after correction for the number of parameters.
SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class RangeEnd:
    """The scenario with one assumed parameter at one end of its range.

    value: of the parameter, SI unit. metrics: of the nonlinear run, SI units; empty if the run failed.
    failures: violated limits of scenario and plant as sentences; baselines are not compared.
    """

    value: float
    metrics: Mapping[str, float]
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not self.failures


@dataclass(frozen=True)
class AssumptionSensitivity:
    """Effect of one assumed parameter on a scenario.

    parameter: from the plant's file. low, high: results at the ends of its range.
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
        """Whether the verdict at either end differs from the nominal one."""
        return any(end.passed != self.nominal_passed for end in self.ends)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for results.json, SI units."""
        return as_dict(
            self, "flips", **as_dict(self.parameter, "name value unit file_unit"), kept=self.nominal_passed,
            ends=[as_dict(end, "value metrics passed failures") for end in self.ends],
        )  # fmt: skip


def assumption_sensitivity(case: PreparedScenario, nominal_passed: bool) -> tuple[AssumptionSensitivity, ...]:
    """Run a scenario with each assumed parameter at both ends of its range, one parameter at a time.

    The controller keeps its design for the nominal values, as on the rig. Parameters set for this run and those
    without bounds in the file are omitted. `monte_carlo` covers combinations of parameters.

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
    """Influence of one parameter on whether a run passes.

    Attributes
    ----------
    measure: "ks", the Kolmogorov-Smirnov distance (0 to 1) between the parameter's distributions in passing and failing
        runs; or, if too few runs pass or fail, "rank", its rank correlation (-1 to 1) with the margin.
    value: of the measure.
    chance: p-value times the number of parameters (Bonferroni correction), at most 1.
    passing, failing: medians, SI unit; nan with "rank".
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
        """One of `influences` in montecarlo.json, SI units."""
        return as_dict(self, "name measure value chance passing failing decisive")

    def __str__(self) -> str:
        name = label(self.name)
        if not self.decisive:
            return f"no parameter is decisive; the strongest is {name} (corrected p-value {self.chance:.2g})"
        if self.measure == "ks":
            side = "high" if self.failing > self.passing else "low"
            return (
                f"{name} is decisive: runs fail if it is {side} (median {self.failing:.4g} in failing runs, "
                f"{self.passing:.4g} in passing runs; Kolmogorov-Smirnov distance {self.value:.2f})"
            )
        trend = "increases" if self.value > 0 else "decreases"
        return f"{name} is decisive: the smallest margin {trend} with it (rank correlation {self.value:.2f})"


def influences(outcomes: Sequence[Outcome], names: Sequence[str]) -> tuple[Influence, ...]:
    """Influence of every parameter on whether runs pass, the strongest first.

    Monte Carlo filtering (R. C. Spear, G. M. Hornberger, Water Research 14, 1980; A. Saltelli and others, "Global
    Sensitivity Analysis: The Primer", Wiley 2008): a parameter is influential if its distributions in passing and
    failing runs differ by the two-sample Kolmogorov-Smirnov test.
    """
    from scipy.stats import ks_2samp, spearmanr

    passed = np.array([outcome.passed for outcome in outcomes], dtype=bool)
    margin = np.array([outcome.margin for outcome in outcomes])
    enough = min(np.count_nonzero(passed), np.count_nonzero(~passed)) >= MIN_RUNS
    found = []
    for name in names:
        values = np.array([outcome.parameters[name] for outcome in outcomes])
        if enough:
            test = ks_2samp(values[passed], values[~passed])
            medians = float(np.median(values[passed])), float(np.median(values[~passed]))
            found.append(Influence(name, "ks", float(test.statistic), float(test.pvalue), *medians))
        elif len(values) >= MIN_RUNS and np.ptp(values) > 0 and np.unique(margin).size > 1:
            rank = spearmanr(values, margin)
            found.append(Influence(name, "rank", float(rank.statistic), float(rank.pvalue), np.nan, np.nan))
    corrected = [replace(i, chance=min(i.chance * len(names), 1.0)) for i in found]
    return tuple(sorted(corrected, key=lambda influence: -abs(influence.value)))
