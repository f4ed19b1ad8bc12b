"""Force targets of a scenario: levels, reached by a step or at a constant rate, and a sine around them."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from ..core.definition import Definition, Hertz, In, Newton, Second


class ForceChange(NamedTuple):
    """One change of the force target."""

    start: float  # s
    end: float  # s, when the target has reached its new level
    before: float  # N
    after: float  # N
    until: float = np.inf  # s, end of the hold: the next change, or the sine


class ForceSine(Definition):
    """amplitude sin(2 pi frequency (t - start)) [N] from `start` on."""

    amplitude: Newton = Field(gt=0, description="amplitude")
    frequency: Hertz = Field(gt=0, description="frequency")
    start: Second = Field(ge=0, description="start time")

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Target (N,) [N] at the times (N,) [s]."""
        since = np.maximum(time - self.start, 0.0)
        return np.asarray(self.amplitude * np.sin(2.0 * np.pi * self.frequency * since))


class ForceLevels(Definition):
    """Levels of the load's force, positive where the rod pushes; zero before the first one, and zero asks for none."""

    times: list[Second] = Field(description="start time of each change")
    forces: list[Newton] = Field(
        description="target after each change, positive where the rod pushes; 0 asks for no force"
    )
    rate: Annotated[float, In("N/s")] | None = Field(
        default=None, gt=0, description="rate of every change; steps if left out"
    )
    sine: ForceSine | None = Field(default=None, description="sine that is added to the levels; none if left out")

    @model_validator(mode="after")
    def _check_levels(self) -> ForceLevels:
        if not self.times or len(self.times) != len(self.forces):
            raise ValueError(
                f"times has {len(self.times)} and forces {len(self.forces)} entries; give one force per time"
            )
        if np.any(np.diff(self.times) <= 0) or self.times[0] < 0:
            raise ValueError("times must increase and be at least 0 s")
        for change, following in zip(self.changes()[:-1], self.times[1:], strict=True):
            if change.end > following + 1e-9:
                raise ValueError(
                    f"the change at {change.start:g} s lasts until {change.end:.4g} s at this rate, but the next one "
                    f"starts at {following:g} s; raise the rate or start later"
                )
        return self

    @property
    def largest(self) -> float:
        """Largest magnitude of the target [N]."""
        return max(map(abs, self.forces)) + (0.0 if self.sine is None else self.sine.amplitude)

    def changes(self) -> list[ForceChange]:
        """All changes of the target in order; a repeated level is not one."""
        found: list[ForceChange] = []
        before, vibrates = 0.0, np.inf if self.sine is None else self.sine.start
        for start, after in zip(self.times, self.forces, strict=True):
            lasts = 0.0 if self.rate is None else abs(after - before) / self.rate
            if after != before:
                found = [*found[:-1], *(one._replace(until=min(one.until, start)) for one in found[-1:])]
                found.append(ForceChange(start, start + lasts, before, after, vibrates))
            before = after
        return found

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Target (N,) [N] at the times (N,) [s]."""
        values = np.zeros(time.size)
        for start, end, before, after, _ in self.changes():
            share = np.ones(time.size) if end == start else np.clip((time - start) / (end - start), 0.0, 1.0)
            values = np.where(time >= start - 1e-9, before + (after - before) * share, values)
        return values if self.sine is None else values + self.sine.signal(time)
