"""Trajectory planning: the fastest motion to a target within limits of speed and acceleration.

A step of the reference makes a loop wind up and overshoot. The actuator can follow the planned motion instead, whose
speed and acceleration are fed forward. A reference within the limits passes unchanged. The plan is time-optimal for a
double integrator: full acceleration towards the curve v^2 = 2 a |distance|, from which full braking just stops at the
target (e.g. A. E. Bryson, Y.-C. Ho, "Applied Optimal Control", section 3.9), here in whole samples.
"""

from __future__ import annotations

from math import sqrt
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core.definition import Definition, In, Second

#: Part of a sample's change of speed or position within which two of them count as equal. Motions begin and end on the
#: grid of samples, where rounding would decide otherwise, and differently for floats and doubles.
ROUNDING = 0.01
#: Velocity [m/s] and acceleration [m/s2] of the reference below which they count as zero: what rounding leaves of a
#: reference at rest, for which friction would be fed forward in full.
STILL, EVEN = 1e-9, 1e-6
#: Sizes of memory and settings of `plan`.
MEMORY, SETTINGS = 6, 5


def plan(reference: np.ndarray, position: float, memory: np.ndarray, settings: np.ndarray) -> None:
    """One sample of the plan: memory[0:4] becomes planned position [m], speed [m/s], acceleration [m/s2], force [N].

    position: measured position [m], where the first motion starts.
    settings: largest speed [m/s] (0: the reference passes unchanged), largest acceleration [m/s2], least duration of a
    motion [s], sample time, 1 if the law follows a force, which is then the fourth number of the reference.
    memory: planned position, speed, acceleration, force; acceleration limit of the present motion (0 before the first
    sample); last target position.
    """
    v_max, a_top, least, T_s = settings[0], settings[1], settings[2], settings[3]
    r, r_v, r_a = reference[0], reference[1], reference[2]
    if abs(r_v) < STILL:
        r_v = 0.0
    if abs(r_a) < EVEN:
        r_a = 0.0
    if settings[4] > 0.0:
        memory[3] = reference[3]
    if v_max == 0.0:
        memory[0], memory[1], memory[2] = r, r_v, r_a
        return
    if memory[4] == 0.0:
        memory[0], memory[4], memory[5] = position, a_top, position
    x, v, near = memory[0], memory[1], 1.0 + ROUNDING
    if r_v != 0.0:
        memory[4] = a_top
    elif abs(r - memory[5]) > 0.25 * near * a_top * T_s * T_s and least > 0.0:
        # The target jumped: a short stroke takes the least duration, with s = a t^2 / 4 from rest to rest.
        memory[4] = min(a_top, max(4.0 * abs(r - x) / (least * least), 0.1 * a_top))
    memory[5] = r
    a_max = memory[4]
    # Remaining distance if this sample brought the speed to that of the target.
    gap = r - x - 0.5 * T_s * (v + r_v)
    if abs(gap) <= 0.25 * near * a_max * T_s * T_s and abs(r_v - v) <= near * a_max * T_s:
        memory[4] = a_top
        memory[0], memory[1], memory[2] = r, r_v, r_a
        return
    # The relative speed after this sample must leave room to brake: relative^2 = 2 a (distance then left).
    relative = a_max * (sqrt(0.25 * T_s * T_s + 2.0 * abs(gap) / a_max) - 0.5 * T_s)
    wanted = r_v + (relative if gap > 0.0 else -relative)
    wanted = min(max(wanted, -v_max), v_max)
    w = v + min(max(wanted - v, -a_max * T_s), a_max * T_s)
    if abs(w - r_v) <= ROUNDING * a_max * T_s:
        w = r_v
    memory[0] = x + 0.5 * T_s * (v + w)
    memory[1] = w
    memory[2] = (w - v) / T_s


class TrajectoryLimits(Definition):
    """[trajectory]: limits of the planned motion that replaces a jump of the target."""

    speed: Annotated[float, In("m/s")] = Field(gt=0, description="largest rod velocity")
    acceleration: Annotated[float, In("m/s2")] = Field(gt=0, description="largest rod acceleration")
    duration: Second = Field(
        default=0.0,
        ge=0,
        description="shortest duration of a motion from rest to rest; a short stroke uses less acceleration, but at "
        "least a tenth of the limit",
    )


def trajectory_settings(limits: TrajectoryLimits | None, sample_time: float, *, force: bool = False) -> np.ndarray:
    """Settings of `plan`; without limits the reference passes unchanged. force: whether the law follows a force."""
    if limits is None:
        return np.array([0.0, 0.0, 0.0, sample_time, float(force)])
    return np.array([limits.speed, limits.acceleration, limits.duration, sample_time, float(force)])
