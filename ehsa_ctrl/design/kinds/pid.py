"""Position PID: filtered derivative, two degrees of freedom, anti-windup; gains given, classic or tuned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Second
from ...core.errors import InputError
from ..laws.pid import Pid
from ..laws.pid_forms import Gains
from ..tuning.pid_files import PidDesign, PidGains, classic_gains
from ..tuning.tune import Tuned, Tuning, tune
from ._kind import ControllerFile, ControllerKind

if TYPE_CHECKING:
    import control

Weight = Annotated[float, Field(ge=0, le=1)]


class PidLoopFile(ControllerFile):
    """What all PID controllers' TOML have."""

    reference_weight: Weight = Field(
        default=1.0,
        description="b, setpoint weight of the proportional part; below 1 reduces overshoot",
    )
    derivative_reference_weight: Weight = Field(default=0.0, description="c, setpoint weight of the derivative part")
    anti_windup: Literal["back_calculation", "conditional", "none"] = Field(
        default="back_calculation",
        description="back_calculation resets the integral with the time constant tracking_time while the current is "
        "limited; conditional stops integrating into the limit; none",
    )
    tracking_time: Second | None = Field(
        default=None,
        description="time constant of back_calculation; left out, sqrt(T_i T_d), or T_i without a derivative",
    )

    @model_validator(mode="after")
    def _windup(self) -> PidLoopFile:
        if self.tracking_time is not None:
            if self.anti_windup != "back_calculation":
                raise ValueError(f"tracking_time belongs to back_calculation, anti_windup is {self.anti_windup!r}")
            if not self.sample_time <= self.tracking_time < np.inf:
                raise ValueError(
                    f"tracking_time = {self.tracking_time:g} s is shorter than sample_time = {self.sample_time:g} s"
                )
        return self

    def law(self, gains: Gains) -> Pid:
        """The law with these gains. Raises InputError for a weight that would leave the rod short of its target."""
        if gains.k_i == 0.0 and self.reference_weight != 1.0:
            raise InputError(
                f"reference_weight = {self.reference_weight:g} without integral action would leave the rod short "
                "of its target; give integral action or leave the weight at 1"
            )
        return Pid(
            gains,
            self.reference_weight,
            self.derivative_reference_weight,
            self.current_limit,
            self._tracking(gains),
            self.anti_windup == "conditional",
            self.sample_time,
        )

    def _tracking(self, gains: Gains) -> float:
        """Time constant of back-calculation: sqrt(T_i T_d) where there is a derivative, T_i where not."""
        if self.anti_windup != "back_calculation" or gains.k_i == 0.0:
            return float("inf")
        if self.tracking_time is not None:
            return self.tracking_time
        T_i = gains.k_p / gains.k_i
        T_t = np.sqrt(gains.k_d / gains.k_i) if gains.k_d > 0 else T_i
        return float(max(T_t, self.sample_time))


class PidFile(PidLoopFile):
    """A PID's TOML: one of [design] (crossover and phase margin), [tuning] (optimised), [gains] (given)."""

    kind: Literal["pid"] = Field(description="type of feedback law")
    design: PidDesign | None = Field(
        default=None,
        description="crossover and phase margin; exactly one of [design], [tuning] and [gains]",
    )
    tuning: Tuning | None = Field(
        default=None, description="optimised gains; exactly one of [design], [tuning] and [gains]"
    )
    gains: PidGains | None = Field(
        default=None, description="given gains; exactly one of [design], [tuning] and [gains]"
    )

    @model_validator(mode="after")
    def _one(self) -> PidFile:
        given = [name for name in ("design", "tuning", "gains") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "give one of the tables [design], [tuning] and [gains]; got " + (" and ".join(given) or "none")
            )
        return self


def design_pid(name: str, file: PidFile, system: control.StateSpace) -> Pid:
    """A PID for the linear model `system` (first input the current, an output x).

    Raises
    ------
    InputError: a [design] or [tuning] that can't be reached on this model; says how near one comes.
    """
    if file.gains is not None:
        return file.law(file.gains.parallel())
    if file.design is not None:
        return file.law(classic_gains(file.design, system, file.sample_time))
    assert file.tuning is not None
    weights = file.reference_weight, file.derivative_reference_weight
    return file.law(tuned(system, file.tuning, file.sample_time, *weights).gains)


def tuned(system: control.StateSpace, asked: Tuning, sample_time: float, b: float, c: float) -> Tuned:
    """`tune`, remembered: a scenario, its linear twin and a comparison load the same controller for the same model."""
    numbers = tuple(matrix.tobytes() for matrix in (system.A, system.B, system.C))
    key = numbers, tuple(system.output_labels), tuple(system.input_labels), asked, sample_time, b, c
    if key not in _FOUND:
        _FOUND[key] = tune(system, asked, sample_time=sample_time, b=b, c=c)
    return _FOUND[key]


_FOUND: dict[object, Tuned] = {}

kind = ControllerKind("pid", "position PID with filtered derivative and anti-windup", PidFile, design_pid)
