"""The four cases of the engine benchmark: plant values, inputs and the error measure, shared by all peers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DT = 0.004  # s, 250 Hz

#: Symbols of the paper, SI units.
VALUES: Mapping[str, float] = {
    "J_M": 3.312e-4, "K_T": 1.6, "D": 5.8887e-7, "K_L": 4.05e-13, "V_10": 2.056e-3, "V_20": 2.033e-3,
    "beta": 1.6e9, "A": 1.52681e-3, "M": 16.52,
    "A_FM": 0.8, "B_FM": 1.35e-3, "C_FM": 0.08, "tau_FM": 10.0,
    "A_FR": 854.0, "B_FR": 9186.0, "C_FR": 213.0, "tau_FR": 5e-3,
}  # fmt: skip

#: omega rad/s, P_1 Pa, P_2 Pa, v m/s, x m: what counts as one unit of each state in an absolute tolerance.
SCALES: Array = np.array([100.0, 5e5, 5e5, 0.05, 0.02])

START: Array = np.array([0.0, 2e6, 2e6, 0.0, 0.0])


@dataclass(frozen=True)
class Case:
    """A run from rest: current (N,) A, held over each sample or joined by lines (first_order), against a spring K_S."""

    name: str
    title: str
    current: Array
    first_order: bool
    K_S: float

    @property
    def duration(self) -> float:
        return (self.current.size - 1) * DT

    @property
    def values(self) -> dict[str, float]:
        return {**VALUES, "K_S": self.K_S}

    def first(self, seconds: float) -> Case:
        """The beginning of this record."""
        return replace(self, current=self.current[: min(self.current.size, round(seconds / DT) + 1)])

    def line(self, k: int) -> tuple[float, float]:
        """Current at sample k and its slope up to the next one."""
        u = float(self.current[k])
        return u, (float(self.current[k + 1]) - u) / DT if self.first_order else 0.0


def cases() -> dict[str, Case]:
    """a: square wave. b: sine against a spring, first-order hold. c: white noise, far beyond the pump's speed limit.

    d: currents held for a second, against which a spring stops the rod slowly, below its Stribeck speed.
    """
    k = np.arange(1001)
    square = np.where(k * DT % 0.5 < 0.25 - 1e-9, 1.5, -1.5)
    sine = 1.5 * np.sin(2 * np.pi * 2.0 * k * DT)
    noise = np.random.default_rng(0).standard_normal(2500)
    noise *= 3.0 / np.sqrt(np.mean(noise**2))
    return {
        "a": Case("a", "+-1.5 A square, 0.5 s period", square, False, 0.0),
        "b": Case("b", "1.5 A 2 Hz sine, spring", sine, True, 1e5),
        "c": Case("c", "3 A rms noise", np.append(noise, 0.0), False, 0.0),
        "d": Case(
            "d", "+-1.2 A held 1 s, spring: slow stops", np.where(k * DT % 2.0 < 1.0 - 1e-9, 1.2, -1.2), False, 1e5
        ),
    }


def worst_error(states: Array, reference: Array) -> float:
    """Largest deviation in time over the largest excursion of the reference, of the worst state; (N, 5) both."""
    span = np.abs(reference - reference[0]).max(axis=0)
    return float((np.abs(states - reference).max(axis=0) / span).max())
