"""How statistics of rigs that have not changed are distributed: the fleet itself shows it (its empirical null).

In theory a statistic is chi-squared. That takes a model without error, which no rig has: what the linearisation leaves,
and what differs from day to day, makes all statistics larger, and single ones much larger. Most rigs of a fleet have
not changed, so that quantiles over the fleet hardly depend on those that have.

- A factor for each cause brings the median of its statistics to that of chi-squared: genomic control, B. Devlin,
  K. Roeder, "Genomic control for association studies", Biometrics 55 (1999).
- The logarithm of the largest statistic of a rig, over causes and times, follows a Gumbel distribution, the limit for
  the largest of many values whose tail is a power: location and scale from quantiles over the fleet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import brentq

# The constants without another reason are engineering judgement.

#: Number of rigs from which a fleet shows its own distribution.
ENOUGH_RIGS = 20
#: Scale of the Gumbel distribution for fewer rigs: the upper end of what simulated fleets show.
USUAL_SCALE = 0.75
#: Quantiles for the scale of the lower half, which holds no changed rig, and of the upper half.
LOWER, UPPER = 0.1, 0.9
#: False-discovery rate at which rigs are taken out before the upper half is looked at.
KNOWN = 0.05
#: Quantile that shows the tail of single statistics, and the degrees of freedom that it may lead to.
TAIL, LEAST_FREEDOM, MOST_FREEDOM = 0.8, 3.0, 100.0


@dataclass(frozen=True)
class LargestNull:
    """Distribution of a rig's largest statistic without a change.

    factor (causes,): at least 1. parameters (causes,): number of each. location, scale: of the Gumbel distribution of
    the logarithm of the largest statistic / (factor parameters).
    """

    factor: np.ndarray
    parameters: np.ndarray
    location: float
    scale: float

    def largest(self, statistic: np.ndarray) -> float:
        """Logarithm of the largest of the statistics (causes, times) of a rig, relative to factor and parameters."""
        tested = self.parameters > 0
        relative = statistic[tested] / (self.factor * self.parameters)[tested, None]
        return float(np.log(max(float(np.max(relative, initial=0.0)), 1e-12)))

    def p(self, statistic: np.ndarray) -> float:
        """Probability that the largest statistic of a rig without a change is as large."""
        return float(-np.expm1(-np.exp(-min((self.largest(statistic) - self.location) / self.scale, 700.0))))


def largest_null(statistics: Sequence[np.ndarray], parameters: np.ndarray) -> LargestNull:
    """The distribution that a fleet shows; for few rigs the theoretical location and USUAL_SCALE.

    statistics: (causes, times) of each rig. parameters: (causes,), 0 for a cause that no log shows.
    """
    tested = parameters > 0
    values = np.concatenate(statistics, axis=1)[tested]
    factor = np.ones(parameters.size)
    ratio = np.median(values, axis=1) / stats.chi2.median(parameters[tested])
    enough = len(statistics) >= ENOUGH_RIGS
    factor[tested] = np.maximum(ratio if enough else np.median(ratio), 1.0)
    # The largest of independent chi-squared variables, one for each cause and time.
    tests = max(int(np.median([one[tested].size for one in statistics])), 1)
    theory = LargestNull(factor, parameters, 0.0, USUAL_SCALE)
    theory = _with_median(theory, float(np.log(stats.chi2.ppf(0.5 ** (1.0 / tests), 1.0))), USUAL_SCALE)
    if not enough:
        return theory
    largest = np.array([theory.largest(one) for one in statistics])
    low, middle = np.quantile(largest, [LOWER, 0.5])
    first = _with_median(theory, float(middle), float(middle - low) / _span(LOWER, 0.5))
    q = false_discovery_rates([first.p(one) for one in statistics])
    kept = largest[q > KNOWN]
    if kept.size < ENOUGH_RIGS:
        return first
    low, middle, high = np.quantile(kept, [LOWER, 0.5, UPPER])
    scale = max((middle - low) / _span(LOWER, 0.5), (high - middle) / _span(0.5, UPPER))
    return _with_median(theory, float(middle), float(scale))


def _span(low: float, high: float) -> float:
    """Distance of two quantiles of the standard Gumbel distribution."""
    return float(stats.gumbel_r.ppf(high) - stats.gumbel_r.ppf(low))


def _with_median(null: LargestNull, median: float, scale: float) -> LargestNull:
    scale = max(scale, 1e-3)
    return LargestNull(null.factor, null.parameters, median - scale * float(stats.gumbel_r.median()), scale)


@dataclass(frozen=True)
class SingleNull:
    """Distribution of single statistics of one parameter each, without a change: factor times F(1, freedom).

    The variance of a score differs from log to log, so that its ratio to the mean follows F rather than chi-squared, as
    in G. K. Smyth, "Linear models and empirical Bayes methods for assessing differential expression in microarray
    experiments", Stat. Appl. Genet. Mol. Biol. 3 (2004).
    """

    factor: np.ndarray
    freedom: float

    def p(self, statistic: np.ndarray) -> np.ndarray:
        """Probability (tests,) of statistics (tests,) as large."""
        return np.asarray(stats.f.sf(statistic / self.factor, 1.0, self.freedom))


def single_null(statistics: np.ndarray) -> SingleNull:
    """The distribution that the statistics (rigs, tests) of a fleet show; LEAST_FREEDOM and factor 1 for few rigs."""
    if len(statistics) < ENOUGH_RIGS:
        return SingleNull(np.ones(statistics.shape[1]), LEAST_FREEDOM)
    middle, high = np.quantile(statistics, [0.5, TAIL], axis=0)
    shown = middle > 0.0
    freedom = _freedom_of(float(np.median(high[shown] / middle[shown]))) if shown.any() else LEAST_FREEDOM
    return SingleNull(np.maximum(middle / stats.f.median(1.0, freedom), 1.0), freedom)


def scatter(statistics: Sequence[np.ndarray]) -> float:
    """Variance between a rig's logs over what each log's own uncertainty makes: median over parameters, at least 1.

    statistics: (parameters, times) of each rig, of one parameter each.
    """
    if not statistics:
        return 1.0
    middle = np.median(np.concatenate(statistics, axis=1), axis=1)
    return max(float(np.median(middle)) / float(stats.chi2.median(1.0)), 1.0)


def _freedom_of(ratio: float) -> float:
    """Degrees of freedom d for which the quantiles TAIL and 0.5 of F(1, d) have this ratio, within the limits."""

    def excess(log_freedom: float) -> float:
        middle, high = stats.f.ppf([0.5, TAIL], 1.0, np.exp(log_freedom))
        return float(high / middle - ratio)

    ends = np.log(LEAST_FREEDOM), np.log(MOST_FREEDOM)
    if excess(ends[0]) <= 0.0:
        return LEAST_FREEDOM
    return MOST_FREEDOM if excess(ends[1]) >= 0.0 else float(np.exp(brentq(excess, *ends)))


def false_discovery_rates(p: Sequence[float]) -> np.ndarray:
    """Smallest false-discovery rate at which each test is significant.

    Y. Benjamini, Y. Hochberg, "Controlling the false discovery rate", J. R. Statist. Soc. B 57 (1995).
    """
    return np.asarray(stats.false_discovery_control(p)) if len(p) else np.zeros(0)
