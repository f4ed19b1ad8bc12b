"""How far a scenario's metrics move over the believed ranges of assumed parameters, as the page shows it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..core.text import join_words
from ..core.unit import factor
from ..plant.file import both
from ..scenario.metrics import METRICS
from ..scenario.result import ScenarioResult
from ..scenario.sensitivity import AssumptionSensitivity, RangeEnd
from .grounds import written
from .number import number, unit

#: Metrics shown where a scenario limits none.
ELSE = ("MaxError", "RMSError", "CurrentRMS")


@dataclass(frozen=True)
class SwingTable:
    """The table of a run: a row for each end of each assumed parameter's range, the believed values first."""

    result: ScenarioResult
    swings: Sequence[AssumptionSensitivity]

    @property
    def metrics(self) -> list[str]:
        """Those that the scenario limits, else the plainest."""
        limited = list(self.result.scenario.definition.limits)
        return [name for name in limited or ELSE if not all(math.isnan(v) for v in self.result.metrics[name])]

    @property
    def head(self) -> list[tuple[str, str]]:
        """Each metric with its unit."""
        return [(name, unit(METRICS[name].shown)) for name in self.metrics]

    @property
    def nominal(self) -> list[str]:
        return [_read(name, self.result.metrics[name][1]) for name in self.metrics]

    @property
    def rows(self) -> list[tuple[str, str, list[str], str, bool, bool]]:
        """Parameter, its value at an end, the metrics there, the verdict in words, whether it passed, whether that
        is another verdict than the believed value has."""
        return [
            (
                both(swing.parameter.name) if index == 0 else "",
                written(swing.parameter, end.value),
                [_read(name, end.metrics.get(name, math.nan)) for name in self.metrics],
                _said(end),
                end.passed,
                end.passed != swing.kept,
            )
            for swing in self.swings
            for index, end in enumerate(swing.ends)
        ]

    @property
    def sentence(self) -> tuple[str, bool]:
        """Whether the verdict holds over all ranges, and whether that is so."""
        many = f"{len(self.swings)} assumed parameter{'s' if len(self.swings) != 1 else ''}"
        flips = [
            f"{both(swing.parameter.name)} = {written(swing.parameter, end.value)}"
            for swing in self.swings
            for end in swing.ends
            if end.passed != swing.kept
        ]
        if not self.swings:
            return "No assumed parameter has a believed range to try.", True
        kept = "kept" if self.swings[0].kept else "not kept"
        if not flips:
            return f"Limits stay {kept} at both ends of the believed range of each of {many}.", True
        other = "not kept" if self.swings[0].kept else "kept"
        return f"Limits are {kept} as believed, but {other} at {join_words(flips)}.", False


def _read(metric: str, value: float) -> str:
    return number(value / factor(METRICS[metric].shown, METRICS[metric].unit))


def _said(end: RangeEnd) -> str:
    return "✓ kept" if end.passed else f"✗ {'; '.join(end.failures)}"
