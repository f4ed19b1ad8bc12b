"""One run of a Monte Carlo campaign: what was drawn, and how it ended."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.files import parse_json
from ..plant.file import label


@dataclass(frozen=True)
class Outcome:
    """One run of a campaign.

    Attributes
    ----------
    run: number of the run. passed: whether the limits of scenario and plant hold.
    margin: smallest margin to a limit relative to that limit; negative if violated, -inf if its metric is nan.
    seed: of the sensor noise. parameters: drawn values, SI units. metrics: the finite ones, SI units.
    failures: as sentences.
    """

    run: int
    passed: bool
    margin: float
    seed: int
    parameters: Mapping[str, float]
    metrics: Mapping[str, float]
    failures: tuple[str, ...] = ()

    def __str__(self) -> str:
        drawn = ", ".join(f"{label(name)} = {value:.5g}" for name, value in self.parameters.items())
        verdict = "passed" if self.passed else "; ".join(self.failures)
        return f"run {self.run} (sensor noise {self.seed}; {drawn or 'no parameter drawn'}): {verdict}"

    def to_line(self) -> str:
        """One line of JSON for the campaign's file."""
        return json.dumps(vars(self) | {"margin": self.margin if math.isfinite(self.margin) else str(self.margin)})

    @classmethod
    def from_line(cls, line: str) -> Outcome:
        """Parse a line of the campaign's file. Raises ValueError, LookupError or TypeError for any other line."""
        content = parse_json(line)
        return cls(**(content | {"margin": float(content["margin"]), "failures": tuple(content["failures"])}))
