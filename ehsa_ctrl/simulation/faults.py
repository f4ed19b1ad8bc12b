"""Faults of sensors and drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.controller_interface import MEASURED
from ..core.errors import InputError, choices

#: Kind of sensor fault -> its code in the compiled loop.
KINDS = {"stuck": 1, "lost": 2}


@dataclass(frozen=True)
class SensorFault:
    """A sensor that repeats its last value ("stuck") or gives none ("lost"), from `start` for `duration` [s]."""

    channel: str
    kind: str
    start: float
    duration: float = float("inf")

    def __post_init__(self) -> None:
        if self.channel not in MEASURED:
            raise InputError(f"fault: channel {self.channel!r} is not known; {choices(self.channel, MEASURED)}")
        if self.kind not in KINDS:
            raise InputError(f"fault of {self.channel}: kind {self.kind!r} is not known; {choices(self.kind, KINDS)}")
        if not (self.start >= 0 and self.duration > 0):
            raise InputError(
                f"fault of {self.channel}: start = {self.start:g} s and duration = {self.duration:g} s; expected at "
                f"least 0 s and more than 0 s"
            )


@dataclass(frozen=True)
class DriveLimit:
    """A drive that limits its current to `current` [A], from `start` for `duration` [s]."""

    current: float
    start: float = 0.0
    duration: float = float("inf")

    def __post_init__(self) -> None:
        if not (self.current >= 0 and self.start >= 0 and self.duration > 0):
            raise InputError(
                f"drive limit of {self.current:g} A from {self.start:g} s for {self.duration:g} s; expected at least "
                f"0 A, at least 0 s and more than 0 s"
            )


@dataclass(frozen=True)
class Faults:
    """All faults of a run."""

    sensors: Sequence[SensorFault] = ()
    drive: Sequence[DriveLimit] = ()

    def tables(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tables for the engine: code in KINDS of each reading (N, 5), int8, 0 for none; largest current (N,) [A]."""
        fault = np.zeros((time.size, len(MEASURED)), dtype=np.int8)
        ceiling = np.full(time.size, np.inf)
        for sensor in self.sensors:
            during = (time >= sensor.start - 1e-9) & (time < sensor.start + sensor.duration - 1e-9)
            fault[during, MEASURED.index(sensor.channel)] = KINDS[sensor.kind]
        for limit in self.drive:
            during = (time >= limit.start - 1e-9) & (time < limit.start + limit.duration - 1e-9)
            ceiling[during] = np.minimum(ceiling[during], limit.current)
        return fault, ceiling
