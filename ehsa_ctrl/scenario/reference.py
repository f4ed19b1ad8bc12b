"""What the rod is asked to do: one form a class, each with its signal and its moments of change."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ..core.definition import Definition, Hertz, Metre, Second


class Steps(Definition):
    """Jumps to `positions` at `times`; zero before the first."""

    kind: Literal["steps"]
    times: list[Second]
    positions: list[Metre]

    @model_validator(mode="after")
    def _fit(self) -> Steps:
        if not self.times or len(self.times) != len(self.positions):
            raise ValueError(
                f"times has {len(self.times)} and positions {len(self.positions)} entries; give one position a time"
            )
        if np.any(np.diff(self.times) <= 0) or self.times[0] < 0:
            raise ValueError("times must grow, from 0 s or later")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (N, 3); a jump has neither speed nor acceleration."""
        values = np.zeros((time.size, 3))
        for at, position in zip(self.times, self.positions, strict=True):
            values[time >= at - 1e-9, 0] = position
        return values

    def jumps(self) -> list[float]:
        """Times at which the target jumps, s."""
        return list(self.times)

    def holds(self) -> list[float]:
        """Times from which on a target is to be held, s."""
        return list(self.times)


class Moves(Definition):
    """Smooth moves to `positions`, each beginning at its time and taking `durations`: quintic, from rest to rest.

    s(t) = 10 t^3 - 15 t^4 + 6 t^5: speed and acceleration start and end at zero.
    """

    kind: Literal["moves"]
    times: list[Second]
    positions: list[Metre]
    durations: list[Second]

    @model_validator(mode="after")
    def _fit(self) -> Moves:
        if not self.times or not len(self.times) == len(self.positions) == len(self.durations):
            raise ValueError(
                f"times, positions and durations have {len(self.times)}, {len(self.positions)} and "
                f"{len(self.durations)} entries; give as many of each"
            )
        ends = [0.0, *(at + takes for at, takes in zip(self.times, self.durations, strict=True))]
        if min(self.durations) <= 0 or any(at < end for at, end in zip(self.times, ends, strict=False)):
            raise ValueError("every move must last more than 0 s and end before the next begins")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (N, 3)."""
        values = np.zeros((time.size, 3))
        start = 0.0
        for at, position, takes in zip(self.times, self.positions, self.durations, strict=True):
            s = np.clip((time - at) / takes, 0.0, 1.0)
            way = position - start
            values[:, 0] += way * s**3 * (10 - 15 * s + 6 * s**2)
            values[:, 1] += way / takes * 30 * s**2 * (1 - s) ** 2
            values[:, 2] += way / takes**2 * 60 * s * (1 - s) * (1 - 2 * s)
            start = position
        return values

    def jumps(self) -> list[float]:
        return []

    def holds(self) -> list[float]:
        return [at + takes for at, takes in zip(self.times, self.durations, strict=True)]


class Sine(Definition):
    """amplitude sin(2 pi frequency (t - start)), at zero before."""

    kind: Literal["sine"]
    amplitude: Metre
    frequency: Hertz
    start: Second = 0.0

    @model_validator(mode="after")
    def _fit(self) -> Sine:
        if self.frequency <= 0 or self.start < 0:
            raise ValueError("frequency must be greater than 0 Hz and start at least 0 s")
        return self

    def signal(self, time: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (N, 3)."""
        w = 2 * np.pi * self.frequency
        t = time - self.start
        on = t >= 0
        columns = [np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)]
        return self.amplitude * np.column_stack(columns) * on[:, None]

    def jumps(self) -> list[float]:
        return []

    def holds(self) -> list[float]:
        return []


Reference = Annotated[Steps | Moves | Sine, Field(discriminator="kind")]
