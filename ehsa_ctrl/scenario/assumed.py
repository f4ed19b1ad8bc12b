"""What a verdict rests on: a scenario with each assumed parameter of the plant at either end of its believed range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError, SimulationError
from ..core.parameter import Parameter
from .result import failures_of

if TYPE_CHECKING:
    from .run import Case


@dataclass(frozen=True)
class End:
    """The scenario with one assumed parameter at one end of its range.

    value: of the parameter, SI unit. metrics: on the nonlinear plant, SI units; empty for a run that could not be
    made. failures: limits of scenario and plant that were not kept, in sentences; baselines play no part.
    """

    value: float
    metrics: Mapping[str, float]
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not self.failures


@dataclass(frozen=True)
class Swing:
    """How far one assumed parameter moves a scenario over the range in which it is believed.

    parameter: as the plant's file has it. low, high: the scenario at the ends of the range. kept: whether the limits
    are kept at the believed value.
    """

    parameter: Parameter
    low: End
    high: End
    kept: bool

    @property
    def ends(self) -> tuple[End, End]:
        return self.low, self.high

    @property
    def flips(self) -> bool:
        """Whether limits that are kept as believed are not kept at an end, or the other way round."""
        return any(end.passed != self.kept for end in self.ends)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for results.json, SI units."""
        return {
            "name": self.parameter.name,
            "value": self.parameter.value,
            "unit": self.parameter.unit,
            "ends": [
                {"value": e.value, "metrics": dict(e.metrics), "passed": e.passed, "failures": list(e.failures)}
                for e in self.ends
            ],
            "flips": self.flips,
        }


def over_assumed(case: Case, kept: bool) -> tuple[Swing, ...]:
    """Run a scenario with each assumed parameter at both ends of its range, one at a time.

    The controller stays as it was designed on what is believed, as it would on the rig: the truth is elsewhere. A
    parameter that a setting gave, and one whose range no file states, has no ends to go to. Effects of two parameters
    together are what `monte_carlo` is for.

    Parameters
    ----------
    kept: whether the limits of scenario and plant are kept at the believed values.
    """
    plant = case.nonlinear
    return tuple(
        Swing(parameter, _end(case, name, parameter.lower), _end(case, name, parameter.upper), kept)
        for name, parameter in plant.parameters.items()
        if parameter.source == "assumed" and isfinite(parameter.lower) and isfinite(parameter.upper)
    )


def _end(case: Case, name: str, value: float) -> End:
    definition = case.scenario.definition
    try:
        loop = case.loop(case.nonlinear.set(**{name: value}))
    except (InputError, SimulationError) as error:
        return End(value, {}, (str(error),))
    metrics = case.metrics(loop, wanted=tuple(definition.limits))
    return End(value, metrics, failures_of(case.judge(metrics), loop.trajectory, definition.expect_trips))
