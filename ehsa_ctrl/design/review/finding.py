"""What a review starts from and what it says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Literal

Verdict = Literal["good", "warning", "fault"]


@dataclass(frozen=True)
class Known:
    """What is known beside the linear model, in SI units; nan where nothing is. scenario.known fills it from a plant.

    static, coulomb: current [A] at breakaway, and that Coulomb friction takes while sliding, unloaded.
    slip: smallest motion [m] that a pulse of current can cause.
    reach: m, largest |position| asked for, for the load's spring.
    solver_time: s, the longest of a sample's solution.
    noise: channel -> standard deviation of its sensor.
    """

    static: float = nan
    coulomb: float = nan
    slip: float = nan
    reach: float = nan
    solver_time: float = nan
    noise: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Finding:
    """One test of a review: what was looked at, what came out, whether it is good, and what to do if not."""

    test: str
    result: str
    verdict: Verdict
    fix: str = ""


def judge(bad: bool, otherwise: Verdict = "warning") -> Verdict:
    """`otherwise` if it is bad."""
    return otherwise if bad else "good"
