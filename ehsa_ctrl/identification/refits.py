"""Fits repeated from the optimum with one parameter held elsewhere: profile likelihood, sensitivity to assumptions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from ..core.errors import InputError
from ..core.parameter import Parameter
from ..core.result import Result, as_dict
from ..core.unit import unit_suffix
from .fit_result import Diverged, Fit
from .gauss_newton import fit
from .identification import Identification
from .parameters import with_values

if TYPE_CHECKING:
    import pandas

#: Where a profile holds its parameter, in standard deviations from the estimate.
PROFILE_POINTS = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
#: Largest number of steps of a refit, for a profile and for an assumed parameter.
PROFILE_STEPS, ASSUMED_STEPS = 15, 20
#: An increase of the cost (three standard deviations of one parameter, squared) from which the log excludes a value.
EXCLUDED = 9.0


def _refit(best: Fit, name: str, value: float, *, steps: int, enough: float) -> Fit | Diverged:
    """Fit again from the optimum with a parameter, estimated or not, held at `value`."""
    others = [i for i, parameter in enumerate(best.parameters) if parameter.name != name]
    measured = best.iterate.runs[0].measured
    weights = None
    if measured.input_sd == 0.0:
        weights = dict(zip(measured.channels, measured.sd.tolist(), strict=True))
    try:
        plant = with_values(best.plant, [name], [value])
    except InputError:
        return Diverged(best.plant.name, (name,), np.array([value]))
    return fit(
        plant,
        [run.window for run in best.iterate.runs],
        [best.parameters[i] for i in others],
        begin=replace(best.iterate, values=best.values[others], runs=()),
        steps=steps, enough=enough, weights=weights, drive_errors=weights is None,
    )  # fmt: skip


@dataclass(frozen=True, repr=False)
class Profile(Result):
    """Cost along one parameter.

    values (m,) in `unit`, rise (m,): increase of the cost there, scaled so that one standard deviation gives 1;
    interval: 95 %, infinite on a side where the cost does not rise enough within three deviations.
    """

    name: str
    unit: str
    values: np.ndarray
    rise: np.ndarray
    interval: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.name}: 95 % interval by profile {low:.5g} to {high:.5g}{unit_suffix(self.unit)}"

    def to_pandas(self) -> pandas.DataFrame:
        """One row a value at which the parameter was held, with the increase of the cost."""
        import pandas

        return pandas.DataFrame({"value": self.values, "rise": self.rise})


def profile(found: Identification, name: str) -> Profile:
    """Profile likelihood of one parameter of an identification by simulation: six fits of the others.

    The interval needs no linearisation: its ends are where the cost has risen by the 95 % point of chi square with one
    degree of freedom. Source: S. A. Murphy, A. W. van der Vaart, J. Am. Stat. Assoc. 95, 2000.

    Raises InputError for a parameter that was not estimated or has no standard deviation, for an identification by
    balances, and where the simulation diverges.
    """
    best = found.fit
    if best is None or found.method != "simulation":
        raise InputError(f"{name}: a profile needs an identification by simulation")
    estimate = found[name]
    if not math.isfinite(estimate.sd) or estimate.sd == 0.0:
        raise InputError(f"{name} has no finite standard deviation: the log does not determine it")
    free = next(parameter for parameter in best.parameters if parameter.name == name)
    scale = 1.0 if found.uncertainty.source == "noise" else best.reduced_cost
    values, rise = [], []
    for step in PROFILE_POINTS:
        value = estimate.value + step * estimate.sd
        if not free.lower <= value <= free.upper:
            continue
        refit = _refit(best, name, value, steps=PROFILE_STEPS, enough=1e-7)
        if isinstance(refit, Diverged):
            raise InputError(f"{name} = {value:g}: {refit}")
        values.append(value)
        rise.append(max(refit.objective - best.objective, 0.0) / scale)
    points, heights = np.array(values), np.array(rise)
    return Profile(name, estimate.unit, points, heights, _profile_interval(estimate.value, points, heights))


def _profile_interval(best: float, points: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Where the square root of the rise, linear for a parabola, crosses the root of the 95 % point."""
    level = math.sqrt(float(stats.chi2.ppf(0.95, 1)))
    ends = []
    for side in (-1.0, 1.0):
        distance = side * (points - best)
        order = np.argsort(distance)
        order = order[distance[order] > 0.0]
        root = np.maximum.accumulate(np.sqrt(np.concatenate([[0.0], heights[order]])))
        reached = float(np.interp(level, root, [0.0, *distance[order]])) if root[-1] >= level else math.inf
        ends.append(best + side * reached)
    return ends[0], ends[1]


@dataclass(frozen=True)
class AssumptionRefit:
    """The estimate with an assumed parameter at one end of its range.

    value: of the assumed parameter, SI unit. values: of the estimated ones; empty where the simulation diverges. cost:
    of the residuals per degree of freedom, 1 for pure noise; nan where there is none. excluded: the log contradicts
    this value by more than three standard deviations.
    """

    value: float
    values: Mapping[str, float]
    cost: float
    excluded: bool


@dataclass(frozen=True)
class EstimateSensitivity:
    """Change of the estimated parameters over the range of an assumed one.

    parameter: as in the plant's file. low, high: refits at the ends. cost: per degree of freedom at the nominal value.
    """

    parameter: Parameter
    low: AssumptionRefit
    high: AssumptionRefit
    cost: float

    @property
    def ends(self) -> tuple[AssumptionRefit, AssumptionRefit]:
        return self.low, self.high

    def to_dict(self) -> dict[str, Any]:
        """Plain values for identification.json, SI units."""
        ends = [as_dict(end, "value cost excluded", parameters=end.values) for end in self.ends]
        return as_dict(self, "cost", ends=ends, **as_dict(self.parameter, "name value unit file_unit"))


def assumption_sensitivities(found: Identification) -> tuple[EstimateSensitivity, ...]:
    """Fit again with each assumed parameter at both ends of its range, one at a time.

    If the cost rises, the log excludes that end, and the parameter can be estimated. If not, the log contains no
    information on it, and the change of the estimates is an error that the standard deviations do not include.

    Raises InputError for an identification by balances, which has no simulation to fit again.
    """
    best = found.fit
    if best is None or found.method != "simulation":
        raise InputError("assumed parameters can be tried for an identification by simulation, not by balances")
    estimated = {estimate.name for estimate in found.estimates}
    return tuple(
        EstimateSensitivity(
            parameter, _at_value(best, name, parameter.lower), _at_value(best, name, parameter.upper), best.reduced_cost
        )
        for name, parameter in found.plant.parameters.items()
        if parameter.source == "assumed" and name not in estimated
        and math.isfinite(parameter.lower) and math.isfinite(parameter.upper)
    )  # fmt: skip


def _at_value(best: Fit, name: str, value: float) -> AssumptionRefit:
    again = _refit(best, name, value, steps=ASSUMED_STEPS, enough=1e-5)
    if isinstance(again, Diverged):
        return AssumptionRefit(value, {}, float("nan"), True)
    names = (parameter.name for parameter in best.parameters)
    rise = (again.cost - best.cost) / max(best.reduced_cost, 1.0)
    values = dict(zip(names, again.values.tolist(), strict=True))
    return AssumptionRefit(value, values, again.reduced_cost, rise > EXCLUDED)
