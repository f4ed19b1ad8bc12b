"""Impedance: the controller kind whose rod yields to a force as a given mass-damper-spring.

The law is in _impedance_law.py: a position loop follows the deviation that the mass-damper-spring would have.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.controller_interface import MEASURED
from ...core.definition import Definition, In
from ..analysis.closed_loop import discrete_response
from ..analysis.sampled import sampled_plant
from ._impedance_law import Impedance, ImpedanceLaw
from ._kind import ControllerFile, ControllerKind
from .force import (
    Environment,
    LoopSpecification,
    loop_gains,
    margins_over_stiffness,
    require_shaft_and_cell,
    travel_per_radian,
)

if TYPE_CHECKING:
    import control

#: Speed of the deviation at which friction is fed forward in full [m/s]: above what the noise of a load cell moves a
#: mass of 100 kg at. Engineering judgement.
SLOW = 2e-3


class ImpedanceTarget(Definition):
    """[impedance]: what the rod behaves as towards the measured force."""

    mass: Annotated[float, In("kg")] = Field(gt=0, description="mass")
    damping: Annotated[float, In("N s/m")] = Field(gt=0, description="damping")
    stiffness: Annotated[float, In("N/m")] = Field(
        ge=0, description="stiffness towards the reference; 0 for a rod that stays where it is pushed"
    )


class ImpedanceFile(ControllerFile):
    """An impedance controller's TOML."""

    kind: Literal["impedance"] = Field(description="type of feedback law")
    impedance: ImpedanceTarget = Field(description="mass, damper and spring")
    position: LoopSpecification = Field(description="position loop that follows their motion")
    environment: Environment = Field(description="stiffness of the environment")

    @model_validator(mode="after")
    def _check_loop(self) -> ImpedanceFile:
        self.position.check("position", self.sample_time)
        target, w = self.impedance, self.position.crossover
        own = max(np.sqrt(target.stiffness / target.mass), target.damping / target.mass)
        if own > w:
            raise ValueError(
                f"[impedance] moves at {own:.4g} rad/s (the larger of sqrt(stiffness / mass) and damping / mass), "
                f"faster than the position loop with its crossover of {w:.4g} rad/s; raise mass or crossover"
            )
        return self


def design_impedance(name: str, file: ImpedanceFile, system: control.StateSpace) -> ImpedanceLaw:
    """The position loop for the linear model `system` (inputs current and F_D, outputs omega and x), exactly sampled.

    Raises InputError for a model that lacks one of these, for an infeasible margin, and for a loop that some stiffness
    of the environment makes unstable.
    """
    require_shaft_and_cell(system, "an impedance controller")
    T_s, w = file.sample_time, file.position.crossover
    free = discrete_response(sampled_plant(system, T_s), w)[0, :, 0]
    x, omega = free[MEASURED.index("position")], free[MEASURED.index("speed")]
    fed, target = file.feedforward, file.impedance
    law = ImpedanceLaw(
        impedance=Impedance(target.mass, target.damping, target.stiffness),
        position=loop_gains(file.position, x, omega, T_s, "position"),
        n=travel_per_radian(x, omega, w, T_s),
        stiffness=file.environment.stiffness,
        inertia=fed.inertia if fed is not None else 0.0,
        viscous=fed.viscous if fed is not None else 0.0,
        friction=fed.coulomb if fed is not None else 0.0,
        slow=SLOW,
        current_limit=file.current_limit,
        sample_time=T_s,
    )
    advice = "raise the mass or the damping of [impedance]"
    return replace(law, margins=margins_over_stiffness(name, "impedance", law, system, file.environment, advice))


kind = ControllerKind(
    "impedance", "yields to a force as a given mass, damper and spring", ImpedanceFile, design_impedance
)
