"""Scenarios as tests: `pytest scenarios/` runs every TOML in a folder of that name.

The plugin comes with the package, so that this works in any project that has ehsa_ctrl installed. A scenario that asks
for nothing (no limit, no expected trip, no baseline) is skipped as untested.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from .result import ScenarioResult

#: Key of what an updated baseline has to say at the end of the session; it survives the way from worker to master.
UPDATED = "ehsa_ctrl baseline"


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("ehsa_ctrl", "scenarios of ehsa_ctrl")
    group.addoption(
        "--scenario-controller", metavar="A,B", default="", help="Run scenarios with these controllers instead."
    )
    group.addoption(
        "--update-baselines",
        action="store_true",
        help="Record runs that have no baseline or have left it; needs --reason.",
    )
    group.addoption("--reason", metavar="TEXT", default="", help="Why the baselines change, kept in their files.")
    group.addoption(
        "--scenario-out", metavar="DIR", default="", help="Figures and CSV tables of scenarios that fail go there."
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--update-baselines") and not config.getoption("--reason").strip():
        raise pytest.UsageError("--update-baselines changes what counts as right: say why with --reason TEXT")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> ScenarioToml | None:
    if file_path.suffix == ".toml" and file_path.parent.name == "scenarios":
        return ScenarioToml.from_parent(parent, path=file_path)
    return None


class ScenarioToml(pytest.File):
    """A scenario's file; a test for each controller."""

    def collect(self) -> Iterator[ScenarioTest]:
        given = [name.strip() for name in self.config.getoption("--scenario-controller").split(",") if name.strip()]
        if not given:
            yield ScenarioTest.from_parent(self, name=self.path.stem, controller=None)
        for name in given:
            yield ScenarioTest.from_parent(self, name=f"{self.path.stem}[{Path(name).stem}]", controller=name)


class ScenarioFailure(Exception):  # noqa: N818 - the scenario fails, not the program
    """Its arguments are the reasons, in sentences."""


class ScenarioTest(pytest.Item):
    """One scenario with one controller."""

    def __init__(self, *, controller: str | None, **rest: Any) -> None:
        super().__init__(**rest)
        self.controller = controller

    def runtest(self) -> None:
        from .run import run

        result = run(self.path, controller=self.controller)
        self.add_report_section("call", "scenario", result.scenario.definition.why)
        if self.config.getoption("--update-baselines"):
            result = self._update(result)
        if result.verdict == "fail":
            self._keep(result)
            raise ScenarioFailure(*result.failures)
        if result.verdict == "untested":
            pytest.skip(f"untested: {self.path.name} sets no limit, expects no trip and has no baseline")

    def _update(self, result: ScenarioResult) -> ScenarioResult:
        """Record the run if it has no baseline or leaves it; what changes is told at the session's end."""
        from .baseline import updated

        new, changes = updated(result, self.config.getoption("--reason"))
        if changes:
            self.user_properties.append((UPDATED, f"{self.name}\n  " + "\n  ".join(changes)))
        return new

    def _keep(self, result: ScenarioResult) -> None:
        """Figure of the run, and the signals with their tubes as a table."""
        if not self.config.getoption("--scenario-out"):
            return
        from ..core.result_folder import ResultFolder

        name = f"{result.scenario.name}-{result.controller.name}"
        # A manifest for each run: several processes may test at once.
        place = ResultFolder(Path(self.config.getoption("--scenario-out")), f"pytest-{name}", force=True)
        with place.draft() as draft:
            result.plot().savefig(draft / f"{name}.png")
            if result.baseline is not None:
                result.baseline.to_pandas(result).to_csv(draft / f"{name}-baseline.csv", index=False)
                result.plot_baseline().savefig(draft / f"{name}-baseline.png")

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Sentences instead of a traceback for what a user can do something about."""
        from ..core.errors import EhsaError

        if isinstance(excinfo.value, ScenarioFailure):
            return "\n".join([f"scenario {self.name} failed:", *(f"  {reason}" for reason in excinfo.value.args)])
        if isinstance(excinfo.value, EhsaError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.path, None, f"scenario {self.name}"


def pytest_terminal_summary(terminalreporter: Any) -> None:
    reports = [report for group in terminalreporter.stats.values() for report in group]
    told = [
        text for report in reports for key, text in getattr(report, "user_properties", ()) if key == UPDATED
        and getattr(report, "when", "") == "call"
    ]  # fmt: skip
    if told:
        terminalreporter.section("baselines recorded")
        for text in told:
            terminalreporter.line(text)
