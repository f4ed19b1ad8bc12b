"""What an identification rests on: the fit made again with each assumed parameter at either end of its range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from ..core.errors import InputError
from ..core.parameter import Parameter
from .estimator import fit
from .free import with_values
from .identification import Identification

#: At most so many steps of a fit that begins at the estimate.
STEPS = 20
#: A sum of squares that is larger by this (three standard deviations of one parameter) speaks against a value.
RISE = 9.0


@dataclass(frozen=True)
class Refit:
    """The estimate with an assumed parameter elsewhere.

    value: of the assumed parameter, SI unit. values: of the identified ones; empty where no simulation could be made.
    cost: of the residuals per degree of freedom, 1 when they are the noise; nan where there is none. excluded: the log
    speaks against this value, by more than three standard deviations.
    """

    value: float
    values: Mapping[str, float]
    cost: float
    excluded: bool


@dataclass(frozen=True)
class Drift:
    """How far one assumed parameter moves the identified ones over the range in which it is believed.

    parameter: as the plant's file has it. low, high: at the ends. cost: per degree of freedom at the believed value.
    """

    parameter: Parameter
    low: Refit
    high: Refit
    cost: float

    @property
    def ends(self) -> tuple[Refit, Refit]:
        return self.low, self.high

    def to_dict(self) -> dict[str, Any]:
        """Plain values for identification.json, SI units."""
        return {
            "name": self.parameter.name,
            "value": self.parameter.value,
            "unit": self.parameter.unit,
            "cost": self.cost,
            "ends": [
                {"value": e.value, "parameters": dict(e.values), "cost": e.cost, "excluded": e.excluded}
                for e in self.ends
            ],
        }


def over_assumed(found: Identification) -> tuple[Drift, ...]:
    """Fit again with each assumed parameter at both ends of its believed range, one at a time, from the estimate on.

    Where the cost rises, the log itself says that the end is wrong: such a parameter may be freed. Where it does not,
    the log can't tell, and what the others move by is an error that no standard deviation holds.

    Raises InputError for an identification by balances, which has no simulation to fit again.
    """
    if found.fit is None or found.method != "simulation":
        raise InputError("assumed parameters can be tried for an identification by simulation, not by balances")
    estimated = {estimate.name for estimate in found.estimates}
    return tuple(
        Drift(
            parameter, _refit(found, name, parameter.lower), _refit(found, name, parameter.upper),
            found.fit.reduced_cost,
        )
        for name, parameter in found.plant.parameters.items()
        if parameter.source == "assumed" and name not in estimated
        and isfinite(parameter.lower) and isfinite(parameter.upper)
    )  # fmt: skip


def _refit(found: Identification, name: str, value: float) -> Refit:
    best = found.fit
    assert best is not None
    measurement = best.point.runs[0].measurement
    weights = None
    if measurement.input_sd == 0.0:
        weights = dict(zip(measurement.channels, measurement.sd.tolist(), strict=True))
    try:
        again = fit(
            with_values(best.plant, [name], [value]), [run.window for run in best.point.runs], best.parameters,
            begin=replace(best.point, runs=()), steps=STEPS, enough=1e-5, weights=weights, drive_errors=weights is None,
        )  # fmt: skip
    except InputError:
        return Refit(value, {}, float("nan"), True)
    names = (parameter.name for parameter in best.parameters)
    rise = (again.cost - best.cost) / max(best.reduced_cost, 1.0)
    return Refit(value, dict(zip(names, again.values.tolist(), strict=True)), again.reduced_cost, rise > RISE)
