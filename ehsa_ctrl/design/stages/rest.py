"""Friction compensation at rest: deadband, knocker and dither.

A PID on a plant whose static friction exceeds Coulomb friction has a limit cycle, whatever its gains (B. Armstrong,
B. Amin, "PID control in the presence of static friction", Automatica 32(5), 1996): its integral winds up until the rod
breaks away, and the slip that follows exceeds the error that caused it. After the end of a planned motion act

- a deadband: while the rod rests within a band around the target, the integral pauses and the law gets the averaged
  readings from the beginning of the rest, so that its current is constant and noise can't make the shaft creep;
- a knocker: outside the band, short pulses of increasing height towards the target until the rod slips. Each pulse ends
  at once, so that the slip stays near the smallest possible one (after T. Hagglund, "A friction compensator for
  pneumatic control valves", J. Process Control 12, 2002, whose pulses replace the integral's slow ramp).

Dither, a fast sine, acts all the time.
"""

from __future__ import annotations

from math import exp, pi, sin

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Definition, Drive, Hertz, Metre, RadianPerSecond, Second

#: Sizes of memory and settings of `rest`.
MEMORY, SETTINGS = 19, 13


def rest(planned: np.ndarray, readings: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> None:
    """One sample: memory[0] becomes 1 while integral action must pause and -1 where it must be reset, memory[1] the
    additional current [A], memory[9:14] the readings for the law.

    settings: band and release [m], speed below which the shaft is at rest [rad/s], filter coefficient; first pulse,
    growth and largest pulse [A], samples of a pulse and from pulse to pulse; amplitude [A] and phase per sample [rad]
    of the dither; samples before the deadband acts; 1 to reset the integral at the next motion.
    memory: hold, additional current, filtered error [m] and shaft speed [rad/s], samples since the end of the planned
    motion, pulse height [A], samples into the pulse's period, phase of the dither, direction of the last pulse;
    readings for the law (5), averaged readings (5).
    """
    amplitude, phase = settings[9], settings[10]
    memory[1] = 0.0
    if amplitude > 0.0:
        memory[1] = amplitude * sin(memory[7])
        memory[7] = (memory[7] + phase) % (2.0 * pi)
    held = memory[0]
    hold = decide_hold(planned, readings, memory, settings)
    memory[0] = hold
    if hold != 1.0:
        memory[9:14] = readings
    elif held == 0.0:
        memory[9:14] = memory[14:19]
        memory[9] = 0.0


def decide_hold(planned: np.ndarray, readings: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """The next memory[0] of `rest`; updates filters, averages and pulses."""
    band, release, rest_speed, decay = settings[0], settings[1], settings[2], settings[3]
    growth, largest, width, patience, forget = settings[5], settings[6], settings[7], settings[11], settings[12]
    if band == 0.0:
        return 0.0
    error = planned[0] - readings[3]
    if planned[1] != 0.0 or planned[2] != 0.0:
        rested = memory[4] > 0.0
        memory[2], memory[3], memory[4], memory[5] = error, readings[0], 0.0, 0.0
        memory[14:19] = readings
        return -1.0 if forget == 1.0 and rested else 0.0
    memory[2] = decay * memory[2] + (1.0 - decay) * error
    memory[3] = decay * memory[3] + (1.0 - decay) * readings[0]
    for i in range(5):
        memory[14 + i] = decay * memory[14 + i] + (1.0 - decay) * readings[i]
    memory[4] += 1.0
    if memory[4] <= patience or abs(memory[3]) >= rest_speed:
        # The rod moves, so that a lower pulse may do next time.
        memory[5], memory[6] = max(memory[5] - 2.0 * growth, 0.0), width
        return 0.0
    if abs(memory[2]) <= (release if memory[0] > 0.0 and memory[5] == 0.0 else band):
        memory[5], memory[6] = 0.0, 0.0
        return 1.0
    if largest == 0.0:
        return 0.0
    # Outside the band the pulses replace the integral.
    knock(memory, settings)
    return 1.0


def knock(memory: np.ndarray, settings: np.ndarray) -> None:
    """One sample of the knocker: adds its pulse to memory[1] of `rest`, the additional current [A]."""
    first, growth, largest, width, period = settings[4], settings[5], settings[6], settings[7], settings[8]
    direction = 1.0 if memory[2] > 0.0 else -1.0
    if memory[5] < first or direction != memory[8]:
        memory[5], memory[6], memory[8] = first, 0.0, direction
    if memory[6] < width:
        memory[1] += direction * memory[5]
    memory[6] += 1.0
    if memory[6] >= period:
        memory[6] = 0.0
        memory[5] = min(memory[5] + growth, largest)


class Knocker(Definition):
    """[rest.knocker]: short pulses that move a rod at rest outside the band towards its target."""

    first: Drive = Field(gt=0, description="height of the first pulse")
    growth: Drive = Field(gt=0, description="increase from pulse to pulse")
    largest: Drive = Field(description="largest height")
    width: Second = Field(default=0.004, gt=0, description="duration of a pulse")
    period: Second = Field(default=0.02, description="time from pulse to pulse")

    @model_validator(mode="after")
    def _check_ranges(self) -> Knocker:
        if self.first > self.largest or self.width >= self.period:
            raise ValueError("first must be at most largest, and width less than period")
        return self


class Rest(Definition):
    """[rest]: deadband for a rod that friction holds near its target."""

    band: Metre = Field(gt=0, description="position error within which a rod at rest is not corrected")
    release: Metre | None = Field(
        default=None, description="position error at which control resumes; by default 1.5 times the band"
    )
    speed: RadianPerSecond = Field(
        default=1.2,
        gt=0,
        description="shaft speed below which the rod counts as at rest; without effect where the plant has no shaft",
    )
    filter_time: Second = Field(default=0.02, ge=0, description="time constant of the filter on error and speed")
    patience: Second = Field(default=0.06, ge=0, description="waiting time after the end of the planned motion")
    forget: bool = Field(
        default=False,
        description="at the start of a motion, reset the integral to its value at the end of the last motion",
    )
    knocker: Knocker | None = Field(default=None, description="pulses that move a rod at rest outside the band")

    @model_validator(mode="after")
    def _check_ranges(self) -> Rest:
        if self.release is not None and self.release < self.band:
            raise ValueError("release must be at least the band")
        return self


class Dither(Definition):
    """[dither]: a sine added to the current."""

    amplitude: Drive = Field(gt=0, description="amplitude")
    frequency: Hertz = Field(gt=0, description="frequency, below half the sample rate")


def rest_settings(rest: Rest | None, dither: Dither | None, sample_time: float) -> np.ndarray:
    """Settings of `rest`; zeros switch a part off."""
    numbers = np.zeros(SETTINGS)
    if rest is not None:
        decay = exp(-sample_time / rest.filter_time) if rest.filter_time > 0 else 0.0
        release = 1.5 * rest.band if rest.release is None else rest.release
        numbers[:4] = rest.band, release, rest.speed, decay
        numbers[11] = round(rest.patience / sample_time)
        numbers[12] = float(rest.forget)
        if rest.knocker is not None:
            k = rest.knocker
            samples = [max(round(time / sample_time), 1) for time in (k.width, k.period)]
            numbers[4:9] = k.first, k.growth, k.largest, *samples
    if dither is not None:
        numbers[9:11] = dither.amplitude, 2 * pi * dither.frequency * sample_time
    return numbers
