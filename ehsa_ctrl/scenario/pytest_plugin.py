"""Scenarios as tests: `pytest scenarios/` runs every scenario file in a folder of that name.

pytest loads the plugin wherever ehsa_ctrl is installed, so the plugin must not affect other tests: its options begin
with --ehsa-, and it collects a TOML file only if its keys are those of a scenario. A scenario without any limit,
expected trip or baseline is skipped as untested. Only this module needs pytest (extra `pytest`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from .result import ScenarioResult

#: Keys that every scenario has, and how many of them identify one: with 3 of 5, a file with a mistyped key is still
#: collected and reported as invalid.
KEYS, MIN_KEYS = {"why", "plant", "controller", "duration", "reference"}, 3
#: Name of the test property that reports an updated baseline; pytest-xdist passes it from worker to controller.
UPDATED_BASELINE = "ehsa_ctrl baseline"


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("ehsa_ctrl", "ehsa_ctrl scenarios")
    group.addoption(
        "--ehsa-controller",
        metavar="A,B",
        default="",
        help="Run the scenarios with these controllers instead of theirs.",
    )
    group.addoption(
        "--ehsa-update-baselines",
        action="store_true",
        help="Record runs that have no baseline or deviate from it; needs --ehsa-reason.",
    )
    group.addoption(
        "--ehsa-reason", metavar="TEXT", default="", help="Why the baselines change; stored in the baseline files."
    )
    group.addoption(
        "--ehsa-out", metavar="DIR", default="", help="Folder for figures and CSV tables of scenarios that fail."
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--ehsa-update-baselines") and not config.getoption("--ehsa-reason").strip():
        raise pytest.UsageError("--ehsa-update-baselines needs --ehsa-reason TEXT: state why the baselines change")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> ScenarioToml | None:
    if file_path.suffix == ".toml" and file_path.parent.name == "scenarios" and _is_scenario(file_path):
        return ScenarioToml.from_parent(parent, path=file_path)
    return None


def _is_scenario(path: Path) -> bool:
    """Whether a file has the keys of a scenario; searches the text, so that invalid TOML is collected and reported."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError):
        return False
    return len(KEYS & set(re.findall(r"(?m)^\s*\[?\s*(\w+)\s*[=\].]", text))) >= MIN_KEYS


class ScenarioToml(pytest.File):
    """A scenario file; one test per controller."""

    def collect(self) -> Iterator[ScenarioTest]:
        given = [name.strip() for name in self.config.getoption("--ehsa-controller").split(",") if name.strip()]
        if not given:
            yield ScenarioTest.from_parent(self, name=self.path.stem, controller=None)
        for name in given:
            yield ScenarioTest.from_parent(self, name=f"{self.path.stem}[{Path(name).stem}]", controller=name)


class ScenarioFailure(Exception):  # noqa: N818 - the scenario fails, not the program
    """A failed scenario; the arguments are the reasons as sentences."""


class ScenarioTest(pytest.Item):
    """One scenario with one controller."""

    def __init__(self, *, controller: str | None, **rest: Any) -> None:
        super().__init__(**rest)
        self.controller = controller

    def runtest(self) -> None:
        from .prepare import with_drive_of
        from .run import run_one

        if self.controller is not None and not with_drive_of([str(self.path)], None, [self.controller]):
            pytest.skip(f"{self.path.name} has a plant with another drive than that of {self.controller}")
        result = run_one(self.path, controller=self.controller)
        self.add_report_section("call", "scenario", result.scenario.definition.why)
        if self.config.getoption("--ehsa-update-baselines"):
            result = self._update(result)
        if result.verdict == "fail":
            self._write_files(result)
            raise ScenarioFailure(*result.failures)
        if result.verdict == "untested":
            pytest.skip(f"untested: {self.path.name} sets no limit, expects no trip and has no baseline")

    def _update(self, result: ScenarioResult) -> ScenarioResult:
        """Record a run that has no baseline or deviates from it; the terminal summary lists the changes."""
        from .baseline_file import update_baseline

        new, changes = update_baseline(result, self.config.getoption("--ehsa-reason"))
        if changes:
            self.user_properties.append((UPDATED_BASELINE, f"{self.name}\n  " + "\n  ".join(changes)))
        return new

    def _write_files(self, result: ScenarioResult) -> None:
        """Write the figure of the run and, with a baseline, the tube figure and its data as CSV."""
        if not self.config.getoption("--ehsa-out"):
            return
        from ..core.result_folder import ResultFolder

        name = f"{result.scenario.name}-{result.controller.name}"
        # One manifest per run: several pytest workers may write at once.
        place = ResultFolder(Path(self.config.getoption("--ehsa-out")), f"pytest-{name}", force=True)
        with place.draft() as draft:
            result.plot().savefig(draft / f"{name}.png")
            if result.baseline is not None:
                result.baseline.to_pandas(result).to_csv(draft / f"{name}-baseline.csv", index=False)
                result.plot_baseline().savefig(draft / f"{name}-baseline.png")

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Plain messages instead of a traceback for failed scenarios and invalid input."""
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
    updates = [
        text for report in reports for key, text in getattr(report, "user_properties", ()) if key == UPDATED_BASELINE
        and getattr(report, "when", "") == "call"
    ]  # fmt: skip
    if updates:
        terminalreporter.section("baselines recorded")
        for text in updates:
            terminalreporter.line(text)
