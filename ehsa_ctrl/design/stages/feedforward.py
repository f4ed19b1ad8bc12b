"""Feedforward: the current of the planned motion, friction included.

    I = load F + inertia a + viscous v + stiffness x + preload
        + sign(v) (coulomb + (static - coulomb) exp(-|v| / stribeck))

in amperes; [feedforward.adaptation] multiplies viscous and dry friction by factors that it estimates. The planned
motion has no noise, and feeding it forward does not affect stability. The coefficients are the model's divided by the
torque constant (paper, (8) to (10)); plant/motion_current.py computes them for a plant.
"""

from __future__ import annotations

from math import exp
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Definition, Drive, In, InDrive, Second
from . import adaptation
from .adaptation import Adaptation, adapt, adaptation_settings, renew_factors

#: First index of the adaptation's memory and settings in those of `feedforward`.
M_ADAPT, S_ADAPT = 2, 9
#: Sizes of memory and settings of `feedforward`.
MEMORY, SETTINGS = M_ADAPT + adaptation.MEMORY, S_ADAPT + adaptation.SETTINGS


def feedforward(planned: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """Current [A] for planned position, speed and acceleration (3,) and the measurements (5,).

    settings: inertia [A s2/m], viscous [A s/m], stiffness [A/m], preload, coulomb, static [A], stribeck [m/s], load
    [A/N], coefficient of the force filter; then those of `adapt`. memory: filtered force [N], 1 after the first sample;
    then that of `adapt`, whose first number, the current of the last sample, the pipeline writes.
    """
    inertia, viscous, stiffness, preload, coulomb, static, stribeck, load, decay = settings[:9]
    adapted = memory[2:]
    own_inertia, own_viscous, own_load = settings[15], settings[16], settings[17]
    adapt(adapted, settings[9:])
    if memory[1] == 0.0:
        memory[0], memory[1] = measured[4], 1.0
    memory[0] = decay * memory[0] + (1.0 - decay) * measured[4]
    x, v, a = planned[0], planned[1], planned[2]
    if settings[9] > 0.0:
        renew_factors(adapted, v, x - measured[3])
    current = load * memory[0] + inertia * a + viscous * v + stiffness * x + preload
    friction = 0.0
    if v != 0.0 and static > 0.0:
        friction = coulomb + (static - coulomb) * exp(-abs(v) / stribeck)
        friction = friction if v > 0.0 else -friction
        current += (1.0 + adapted[14]) * friction
    # A law may know the viscous friction of the model itself; then only the difference is fed forward.
    current += adapted[13] * own_viscous * v
    adapted[1] = own_inertia * a + stiffness * x + preload + own_load * measured[4]
    adapted[2] = own_viscous * v
    adapted[3] = friction
    return current


class Feedforward(Definition):
    """[feedforward]: coefficients of the model divided by its torque constant; zero where left out."""

    inertia: Annotated[float, InDrive("A s2/m")] = Field(default=0.0, description="current per planned acceleration")
    viscous: Annotated[float, InDrive("A s/m")] = Field(default=0.0, description="current per planned velocity")
    stiffness: Annotated[float, InDrive("A/m")] = Field(default=0.0, description="current per planned position")
    preload: Drive = Field(
        default=0.0, description="constant current, positive where a constant load resists extension"
    )
    coulomb: Drive = Field(default=0.0, ge=0, description="current against Coulomb friction during motion")
    static: Drive | None = Field(
        default=None,
        description="current against friction at the start of a motion, at least `coulomb`, the default",
    )
    stribeck: Annotated[float, In("m/s")] = Field(
        default=0.01, gt=0, description="velocity over which the friction current falls from static to coulomb"
    )
    load: Annotated[float, InDrive("A/N")] = Field(
        default=0.0,
        description="current per measured load force, filtered with force_time. This is feedback: if the load depends "
        "on position, it changes the stability margins",
    )
    force_time: Second = Field(default=0.01, ge=0, description="time constant of the force filter")
    adaptation: Adaptation | None = Field(
        default=None, description="factors of the friction that follow a drift; constant friction if left out"
    )

    @model_validator(mode="after")
    def _check_static(self) -> Feedforward:
        if self.static is not None and self.static < self.coulomb:
            raise ValueError(f"static = {self.static:g}; expected at least coulomb, {self.coulomb:g}")
        if self.adaptation is not None and self.coulomb == 0.0:
            raise ValueError("adaptation needs a coulomb current to start from; give coulomb, or leave adaptation out")
        return self


def feedforward_settings(
    numbers: Feedforward | None, sample_time: float, current_limit: float = float("inf")
) -> np.ndarray:
    """Settings of `feedforward`; zeros for None. At current_limit [A] the adaptation is frozen."""
    n = numbers or Feedforward()
    static = n.coulomb if n.static is None else n.static
    decay = exp(-sample_time / n.force_time) if n.force_time > 0 else 0.0
    friction = [n.coulomb, static, n.stribeck]
    adapts = adaptation_settings(n.adaptation, n.coulomb, (n.inertia, n.viscous, n.load), sample_time, current_limit)
    return np.array([n.inertia, n.viscous, n.stiffness, n.preload, *friction, n.load, decay, *adapts])
