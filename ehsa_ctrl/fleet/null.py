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

# The constants without another reason are engineering judgement.

#: Number of rigs from which a fleet shows its own distribution.
ENOUGH_RIGS = 20
#: Scale of the Gumbel distribution for fewer rigs: the upper end of what simulated fleets show.
USUAL_SCALE = 0.75
#: Quantiles for the scale of the lower half, which holds no changed rig, and of the upper half.
LOWER, UPPER = 0.1, 0.9
#: False-discovery rate at which rigs are taken out before the upper half is looked at.
KNOWN = 0.05


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
    """The distribution that a fleet shows; for few rigs the theoretical location, and USUAL_SCALE or more.

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
    low, middle, high = np.log(stats.chi2.ppf(np.array([LOWER, 0.5, UPPER]) ** (1.0 / tests), 1.0))
    theory = _with_median(LargestNull(factor, parameters, 0.0, USUAL_SCALE), float(middle), USUAL_SCALE)
    if not enough:
        return theory
    # The upper half belongs to the lower one as in theory: of few tests, the lower one is by far the longer.
    above = float((high - middle) / (middle - low))
    largest = np.array([theory.largest(one) for one in statistics])
    low, middle = np.quantile(largest, [LOWER, 0.5])
    scale = float(middle - low) * above / _span(0.5, UPPER)
    first = _with_median(theory, float(middle), scale)
    kept = largest[false_discovery_rates([first.p(one) for one in statistics]) > KNOWN]
    if kept.size >= ENOUGH_RIGS:
        low, middle, high = np.quantile(kept, [LOWER, 0.5, UPPER])
        scale = max(float(middle - low) * above, float(high - middle)) / _span(0.5, UPPER)
    # Quantiles of few rigs are uncertain: the fewer they are, the nearer to the usual scale.
    scale = max(scale, scale + (USUAL_SCALE - scale) * ENOUGH_RIGS / len(statistics))
    return _with_median(theory, float(middle), scale)


def _span(low: float, high: float) -> float:
    """Distance of two quantiles of the standard Gumbel distribution."""
    return float(stats.gumbel_r.ppf(high) - stats.gumbel_r.ppf(low))


def _with_median(null: LargestNull, median: float, scale: float) -> LargestNull:
    scale = max(scale, 1e-3)
    return LargestNull(null.factor, null.parameters, median - scale * float(stats.gumbel_r.median()), scale)


def scatter(statistics: Sequence[np.ndarray]) -> float:
    """Variance between a rig's logs over what each log's own uncertainty makes: median over parameters, at least 1.

    statistics: (parameters, times) of each rig, of one parameter each.
    """
    if not statistics:
        return 1.0
    middle = np.median(np.concatenate(statistics, axis=1), axis=1)
    return max(float(np.median(middle)) / float(stats.chi2.median(1.0)), 1.0)


def false_discovery_rates(p: Sequence[float]) -> np.ndarray:
    """Smallest false-discovery rate at which each test is significant.

    Y. Benjamini, Y. Hochberg, "Controlling the false discovery rate", J. R. Statist. Soc. B 57 (1995).
    """
    return np.asarray(stats.false_discovery_control(p)) if len(p) else np.zeros(0)
