"""A trajectory from a target that jumps: the fastest one within limits of speed and acceleration.

A loop that gets a jump sees an error that no actuator can follow at once, winds up and overshoots. The planned motion
is one that the actuator can follow; its speed and acceleration feed the controller forward. A reference that is
smooth enough passes unchanged. Time-optimal for a double integrator: full acceleration towards the curve
v^2 = 2 a |distance| from which full braking just stops at the target (L. S. Pontryagin's example; e.g. A. E. Bryson,
Y.-C. Ho, "Applied Optimal Control", section 3.9), here in whole samples.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Definition, In, Second

#: Numbers of memory and of settings that `plan` has.
MEMORY, SETTINGS = 5, 4


def plan(reference: np.ndarray, position: float, memory: np.ndarray, settings: np.ndarray) -> None:
    """One sample: memory[0:3] becomes position, speed and acceleration to be followed.

    position: measured, from where the first motion begins.
    settings: largest speed [m/s] (0: the reference passes as it is), largest acceleration [m/s2], least duration of a
    motion [s], sample time.
    memory: planned position, speed, acceleration;
    acceleration of the present motion (0 before the first sample); position of the target before.
    """
    v_max, a_top, least, T_s = settings[0], settings[1], settings[2], settings[3]
    r, r_v = reference[0], reference[1]
    if v_max == 0.0:
        memory[0], memory[1], memory[2] = r, r_v, reference[2]
        return
    if memory[3] == 0.0:
        memory[0], memory[3], memory[4] = position, a_top, position
    x, v = memory[0], memory[1]
    if r_v != 0.0:
        memory[3] = a_top
    elif abs(r - memory[4]) > 0.25 * a_top * T_s * T_s and least > 0.0:
        # The target jumped: a short way is made more slowly, as s = a t^2 / 4 from rest to rest.
        memory[3] = min(a_top, max(4.0 * abs(r - x) / (least * least), 0.1 * a_top))
    memory[4] = r
    a_max = memory[3]
    # What would be left of the way if the speed became the target's within this sample.
    gap = r - x - 0.5 * T_s * (v + r_v)
    if abs(gap) <= 0.25 * a_max * T_s * T_s and abs(r_v - v) <= a_max * T_s:
        memory[3] = a_top
        memory[0], memory[1], memory[2] = r, r_v, reference[2]
        return
    # The speed relative to the target's after this sample must leave room to brake: relative^2 = 2 a (way then left).
    relative = a_max * (sqrt(0.25 * T_s * T_s + 2.0 * abs(gap) / a_max) - 0.5 * T_s)
    wanted = r_v + (relative if gap > 0.0 else -relative)
    wanted = min(max(wanted, -v_max), v_max)
    w = v + min(max(wanted - v, -a_max * T_s), a_max * T_s)
    memory[0] = x + 0.5 * T_s * (v + w)
    memory[1] = w
    memory[2] = (w - v) / T_s


class Trajectory(Definition):
    """A controller's [trajectory]: limits within which a jump of the target becomes a motion."""

    speed: Annotated[float, In("m/s")] = Field(description="largest rod velocity")
    acceleration: Annotated[float, In("m/s2")] = Field(description="largest rod acceleration")
    duration: Second = Field(
        default=0.0,
        description="shortest duration of a motion from rest to rest; short strokes use less acceleration, at least "
        "a tenth of the largest",
    )

    @model_validator(mode="after")
    def _fit(self) -> Trajectory:
        if not 0 < self.speed < inf or not 0 < self.acceleration < inf:
            raise ValueError("speed and acceleration must be greater than 0")
        if not 0 <= self.duration < inf:
            raise ValueError("duration must be at least 0 s")
        return self


def trajectory_settings(limits: Trajectory | None, sample_time: float) -> np.ndarray:
    """Numbers for `plan`; without limits the reference passes as it is."""
    if limits is None:
        return np.array([0.0, 0.0, 0.0, sample_time])
    return np.array([limits.speed, limits.acceleration, limits.duration, sample_time])
