"""Several controllers in the same scenario: their results, by position or by the controller's name, and one table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError, choices
from ..core.result import Result
from .metrics import METRICS
from .result import ScenarioResult, first_reasons

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class ControllerComparison(Result):
    """The runs of one scenario with several controllers, in their order.

    `comparison["lqr_friction"]` and `comparison[0]` are a ScenarioResult.
    """

    results: tuple[ScenarioResult, ...]

    def __getitem__(self, controller: str | int) -> ScenarioResult:
        """The result of a controller by its name or position. Raises InputError for a name that is not there."""
        if not isinstance(controller, str):
            return self.results[controller]
        found = {result.controller.name: result for result in self.results}
        if controller not in found:
            raise InputError(f"no run with controller {controller!r}; {choices(controller, found)}")
        return found[controller]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[ScenarioResult]:
        return iter(self.results)

    @property
    def passed(self) -> bool:
        """Whether all runs passed."""
        return all(result.passed for result in self.results)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, SI units, as in results.json."""
        return {"passed": self.passed, "scenarios": [result.to_dict() for result in self.results]}

    def to_pandas(self) -> pandas.DataFrame:
        """One row per metric, one column per controller: the nonlinear outcomes in display units."""
        import pandas

        columns: dict[str, Any] = {"unit": self.results[0].to_pandas()["unit"]}
        columns |= {result.controller.name: result.to_pandas()["nonlinear"] for result in self.results}
        return pandas.DataFrame(columns)

    def table(self) -> pandas.DataFrame:
        """The table of `to_pandas` with formatted cells, without metrics that no run has."""
        frame = self.to_pandas()
        for result in self.results:
            frame[result.controller.name] = [result.cell(name, result.metrics[name][1]) for name in METRICS]
        frame["unit"] = frame["unit"].replace("1", "")
        cells = frame.drop(columns="unit")
        return frame[~cells.isin(["-", "not defined"]).all(axis="columns")]

    def __str__(self) -> str:
        lines = [
            f"{result.scenario.name} with {result.controller.name}: "
            + ("passed" if result.passed else f"FAILED: {first_reasons(result.failures)}")
            for result in self.results
        ]
        return "\n".join([*lines, self.table().to_string()])

    def _repr_html_(self) -> str:
        import html

        lines = str(self).splitlines()[: len(self.results)]
        return "".join(f"<p>{html.escape(line)}</p>" for line in lines) + str(self.table().to_html())
