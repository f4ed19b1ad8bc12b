"""Adaptation of the friction that is fed forward: two factors, of viscous and of dry friction, estimated in operation.

Along a planned motion the current of the last sample should have been

    y = I - (inertia a + stiffness x + preload + load F) = (1 + s_v) viscous v + (1 + s_c) friction(v)

Both sides pass the same low-pass filter, which starts from zero with each motion. A normalised gradient (P. A. Ioannou,
J. Sun, "Robust Adaptive Control", Prentice Hall 1996, ch. 4) moves the estimates against the difference, and a
projection keeps them within their bounds. At rest, where friction is no function of the motion, and at the current's
limit they are frozen. The planned motion has no noise, and the applied current contains what the feedback law added,
whatever its kind.

The factors in use are renewed where the plan starts or reverses, because within a motion the law's integral holds what
they lack. They follow an estimate only if the position agrees: larger while the rod lagged behind the plan, smaller
while it led, weighed by that friction over the motion. A law that lags by itself is helped by a friction current that
is too large, and the true one would make it worse.
"""

from __future__ import annotations

from math import exp, inf
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Definition, InDrive, Second

#: Sizes of memory and settings of `adapt`.
MEMORY, SETTINGS = 15, 9
#: Share of the friction's square that the gradient's norm does not fall below: motions in which little friction acts
#: count little. Engineering judgement.
LEAST_SHARE = 0.01
#: End of the descriptions of the motion's current.
DEFAULT = "; by default that of [feedforward], which leaves out what the law itself knows of the plant"
#: Traces of a controller that adapts: name -> index in the memory of `adapt`.
TRACES = {"viscous_factor": 13, "friction_factor": 14}


def adapt(memory: np.ndarray, settings: np.ndarray) -> None:
    """One sample: moves the estimates memory[7] = s_v and memory[8] = s_c by the last sample's current.

    settings: share of the remaining difference that one sample corrects (0: off), coefficient of the filter, least and
    largest factor less 1, least norm [A2], current limit [A]; of the motion's current, for the caller: inertia
    [A s2/m], viscous [A s/m], load [A/N].
    memory: current of the last sample [A], its part that is not friction, its viscous and its dry friction [A]; the
    filtered difference of the first two and the filtered frictions [A]; estimates of s_v, s_c; planned velocity [m/s]
    and position error [m] of the last sample; sums of the error times either friction [A m]; s_v, s_c in use.
    """
    share, decay, least, most, norm, limit = settings[:6]
    if share == 0.0:
        return
    if memory[9] == 0.0:
        memory[4] = 0.0
        memory[5] = 0.0
        memory[6] = 0.0
        return
    memory[4] = decay * memory[4] + (1.0 - decay) * (memory[0] - memory[1])
    memory[5] = decay * memory[5] + (1.0 - decay) * memory[2]
    memory[6] = decay * memory[6] + (1.0 - decay) * memory[3]
    if abs(memory[0]) >= limit:
        return
    memory[11] += memory[10] * memory[2]
    memory[12] += memory[10] * memory[3]
    difference = memory[4] - (1.0 + memory[7]) * memory[5] - (1.0 + memory[8]) * memory[6]
    step = share * difference / (norm + memory[5] * memory[5] + memory[6] * memory[6])
    memory[7] = min(max(memory[7] + step * memory[5], least), most)
    memory[8] = min(max(memory[8] + step * memory[6], least), most)


def renew_factors(memory: np.ndarray, velocity: float, error: float) -> None:
    """At the start or the reversal of a planned motion: use the estimates with which the position error agrees.

    memory: as of `adapt`. velocity: planned, of this sample [m/s]. error: of the position in this sample [m].
    """
    if velocity != 0.0 and velocity * memory[9] <= 0.0:
        if (memory[7] - memory[13]) * memory[11] > 0.0:
            memory[13] = memory[7]
        if (memory[8] - memory[14]) * memory[12] > 0.0:
            memory[14] = memory[8]
        memory[7] = memory[13]
        memory[8] = memory[14]
        memory[11] = 0.0
        memory[12] = 0.0
    memory[9] = velocity
    memory[10] = error


class Adaptation(Definition):
    """[feedforward.adaptation]: the friction of [feedforward] follows a drift, such as that of warming oil."""

    time: Second = Field(
        default=2.0, gt=0, description="time of motion in which the error of an estimate falls to 37 %"
    )
    least: float = Field(default=0.3, gt=0, lt=1, description="smallest factor of viscous and of dry friction")
    most: float = Field(default=2.5, gt=1, lt=inf, description="largest factor of viscous and of dry friction")
    filter_time: Second = Field(default=0.05, ge=0, description="time constant of the filter on current and friction")
    inertia: Annotated[float, InDrive("A s2/m")] | None = Field(
        default=None, description=f"current per planned acceleration{DEFAULT}"
    )
    viscous: Annotated[float, InDrive("A s/m")] | None = Field(
        default=None, description=f"current per planned velocity{DEFAULT}"
    )
    load: Annotated[float, InDrive("A/N")] | None = Field(
        default=None, description=f"current per measured load force, by which it is told from friction{DEFAULT}"
    )

    @model_validator(mode="after")
    def _check_times(self) -> Adaptation:
        if self.time < 10.0 * self.filter_time:
            raise ValueError(
                f"time = {self.time:g} s must be at least 10 times filter_time = {self.filter_time:g} s; otherwise the "
                "factors follow single motions instead of the friction"
            )
        return self


def adaptation_settings(
    numbers: Adaptation | None,
    coulomb: float,
    motion: tuple[float, float, float],
    sample_time: float,
    current_limit: float,
) -> np.ndarray:
    """Settings of `adapt` (SETTINGS,); zeros for None.

    coulomb [A], motion (inertia [A s2/m], viscous [A s/m], load [A/N]): those of [feedforward].
    """
    if numbers is None:
        return np.zeros(SETTINGS)
    decay = exp(-sample_time / numbers.filter_time) if numbers.filter_time > 0 else 0.0
    stated = numbers.inertia, numbers.viscous, numbers.load
    own = [usual if number is None else number for number, usual in zip(stated, motion, strict=True)]
    least = LEAST_SHARE * coulomb**2
    factors = numbers.least - 1.0, numbers.most - 1.0
    return np.array([sample_time / numbers.time, decay, *factors, least, current_limit * (1.0 - 1e-9), *own])
