"""Profile likelihood: how the fit worsens when one parameter is held elsewhere and the others make the best of it.

The interval that comes of it needs no linearisation: its ends are where the cost has risen by the 95 % point of chi
square with one degree of freedom. Source: S. A. Murphy, A. W. van der Vaart, J. Am. Stat. Assoc. 95, 2000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from ..core.errors import InputError, choices
from ..core.text import TextResult
from .estimator import fit
from .free import with_values
from .identification import Identification

if TYPE_CHECKING:
    import pandas

#: Where the parameter is held, in standard deviations from its estimate.
STEPS = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)


@dataclass(frozen=True)
class Profile(TextResult):
    """Cost along one parameter.

    values (m,) in `unit`, rise (m,): how much larger the cost is there, in units in which one standard deviation
    makes 1; interval: 95 %, infinite on a side where the cost does not rise enough within three deviations.
    """

    name: str
    unit: str
    values: np.ndarray
    rise: np.ndarray
    interval: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.name}: 95 % interval by profile {low:.5g} to {high:.5g} {self.unit}"

    __repr__ = __str__

    def to_pandas(self) -> pandas.DataFrame:
        """One row a value of the parameter that was held: how much larger the cost is there."""
        import pandas

        return pandas.DataFrame({"value": self.values, "rise": self.rise})


def profile(found: Identification, name: str) -> Profile:
    """Profile one estimated parameter of an identification by simulation: six fits of the others.

    Raises InputError for a parameter that was not estimated, that has no standard deviation, or for an identification
    by balances.
    """
    names = [estimate.name for estimate in found.estimates]
    if found.fit is None or found.method != "simulation":
        raise InputError(f"{name}: a profile needs an identification by simulation")
    if name not in names:
        raise InputError(f"{name} was not estimated; {choices(name, names)}")
    estimate = found[name]
    if not math.isfinite(estimate.sd) or estimate.sd == 0.0:
        raise InputError(f"{name} has no standard deviation to take steps of: the log does not show it")
    best = found.fit
    at = names.index(name)
    others = [parameter for parameter in best.parameters if parameter.name != name]
    windows = [run.window for run in best.point.runs]
    measurement = best.point.runs[0].measurement
    scale = 1.0 if found.uncertainty.source == "noise" else best.reduced_cost
    weights = None
    if measurement.input_sd == 0.0:
        weights = dict(zip(measurement.channels, measurement.sd.tolist(), strict=True))
    lower, upper = best.parameters[at].lower, best.parameters[at].upper
    values, rise = [], []
    for step in STEPS:
        value = estimate.value + step * estimate.sd
        if not lower <= value <= upper:
            continue
        plant = with_values(best.plant, [name], [value])
        begin = replace(best.point, values=np.delete(best.values, at), runs=())
        refit = fit(
            plant, windows, others, begin=begin, steps=15, enough=1e-7, weights=weights,
            drive_errors=weights is None,
        )  # fmt: skip
        values.append(value)
        rise.append(max(refit.lowered - best.lowered, 0.0) / scale)
    order = np.argsort(values)
    points, heights = np.array(values)[order], np.array(rise)[order]
    return Profile(name, estimate.unit, points, heights, _interval(estimate.value, points, heights))


def _interval(best: float, points: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Where the root of the rise, which is straight for a parabola, passes that of the 95 % point."""
    level = math.sqrt(float(stats.chi2.ppf(0.95, 1)))
    ends = []
    for side in (-1.0, 1.0):
        there = side * (points - best) > 0.0
        distance = np.concatenate([[0.0], np.sort(np.abs(points[there] - best))])
        root = np.sqrt(np.concatenate([[0.0], heights[there][np.argsort(np.abs(points[there] - best))]]))
        root = np.maximum.accumulate(root)
        reach = float(np.interp(level, root, distance)) if root[-1] >= level else math.inf
        ends.append(best + side * reach)
    return ends[0], ends[1]
