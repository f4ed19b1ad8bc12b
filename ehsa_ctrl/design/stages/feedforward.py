"""Feedforward: the current of the planned motion, friction included.

    I = load F + inertia a + viscous v + stiffness x + preload
        + sign(v) (coulomb + (static - coulomb) exp(-|v| / stribeck))

in amperes. The planned motion has no noise, and feeding it forward does not affect stability. The coefficients are the
model's divided by the torque constant (paper, (8) to (10)); plant/motion_current.py computes them for a plant.
"""

from __future__ import annotations

from math import exp
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Ampere, Definition, In, Second

#: Sizes of memory and settings of `feedforward`.
MEMORY, SETTINGS = 2, 9


def feedforward(planned: np.ndarray, force: float, memory: np.ndarray, settings: np.ndarray) -> float:
    """Current [A] for planned position, speed and acceleration (3,) and the measured force [N].

    settings: inertia [A s2/m], viscous [A s/m], stiffness [A/m], preload, coulomb, static [A], stribeck [m/s], load
    [A/N], coefficient of the force filter. memory: filtered force [N], 1 after the first sample.
    """
    inertia, viscous, stiffness, preload, coulomb, static, stribeck, load, decay = settings
    if memory[1] == 0.0:
        memory[0], memory[1] = force, 1.0
    memory[0] = decay * memory[0] + (1.0 - decay) * force
    x, v, a = planned[0], planned[1], planned[2]
    current = load * memory[0] + inertia * a + viscous * v + stiffness * x + preload
    if v != 0.0 and static > 0.0:
        friction = coulomb + (static - coulomb) * exp(-abs(v) / stribeck)
        current += friction if v > 0.0 else -friction
    return current


class Feedforward(Definition):
    """[feedforward]: coefficients of the model divided by its torque constant; zero where left out."""

    inertia: Annotated[float, In("A s2/m")] = Field(default=0.0, description="current per planned acceleration")
    viscous: Annotated[float, In("A s/m")] = Field(default=0.0, description="current per planned velocity")
    stiffness: Annotated[float, In("A/m")] = Field(default=0.0, description="current per planned position")
    preload: Ampere = Field(
        default=0.0, description="constant current, positive where a constant load resists extension"
    )
    coulomb: Ampere = Field(default=0.0, ge=0, description="current against Coulomb friction during motion")
    static: Ampere | None = Field(
        default=None,
        description="current against friction at the start of a motion, at least `coulomb`, the default",
    )
    stribeck: Annotated[float, In("m/s")] = Field(
        default=0.01, gt=0, description="velocity over which the friction current falls from static to coulomb"
    )
    load: Annotated[float, In("A/N")] = Field(
        default=0.0,
        description="current per measured load force, filtered with force_time. This is feedback: if the load depends "
        "on position, it changes the stability margins",
    )
    force_time: Second = Field(default=0.01, ge=0, description="time constant of the force filter")

    @model_validator(mode="after")
    def _check_static(self) -> Feedforward:
        if self.static is not None and self.static < self.coulomb:
            raise ValueError(f"static = {self.static:g} A; expected at least coulomb, {self.coulomb:g} A")
        return self


def feedforward_settings(numbers: Feedforward | None, sample_time: float) -> np.ndarray:
    """Settings of `feedforward`; zeros for None."""
    n = numbers or Feedforward()
    static = n.coulomb if n.static is None else n.static
    decay = exp(-sample_time / n.force_time) if n.force_time > 0 else 0.0
    friction = [n.coulomb, static, n.stribeck]
    return np.array([n.inertia, n.viscous, n.stiffness, n.preload, *friction, n.load, decay])
