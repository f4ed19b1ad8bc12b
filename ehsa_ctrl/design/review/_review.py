"""A review: all tests of a design, as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from ...core.errors import InputError, choices
from ...core.protocol import Controller
from ..analysis.loop import LoopAnalysis, analyse_loop
from .case import Case
from .finding import Finding, Known
from .friction import creep, friction
from .linear import margins, noise, solver, stable, standing, worst
from .model import reach, scaling

if TYPE_CHECKING:
    import control
    import pandas

    from ..analysis.robustness import RobustMargins

#: In the order in which they are shown.
TESTS: tuple[Callable[[Case], Iterator[Finding]], ...] = (
    reach, stable, margins, worst, scaling, standing, creep, friction, noise, solver,
)  # fmt: skip


@dataclass(frozen=True)
class Review:
    """The findings of a review, in the order of the tests.

    Attributes
    ----------
    controller: its name.
    findings: one a test.
    loop: the analysis that most of them rest on.
    """

    controller: str
    findings: tuple[Finding, ...]
    loop: LoopAnalysis

    @property
    def passed(self) -> bool:
        """Whether no finding is a fault."""
        return all(finding.verdict != "fault" for finding in self.findings)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """What is not good, faults first."""
        bad = [finding for finding in self.findings if finding.verdict != "good"]
        return tuple(sorted(bad, key=lambda finding: finding.verdict != "fault"))

    def __getitem__(self, test: str) -> Finding:
        """The finding of a test. Raises InputError for a test that was not made."""
        for finding in self.findings:
            if finding.test == test:
                return finding
        raise InputError(f"the review made no test {test!r}; {choices(test, [f.test for f in self.findings])}")

    def to_pandas(self) -> pandas.DataFrame:
        """One row a test: result, verdict, fix."""
        import pandas

        rows = [(f.result, f.verdict, f.fix) for f in self.findings]
        tests = pandas.Index([f.test for f in self.findings], name="test")
        return pandas.DataFrame(rows, index=tests, columns=["result", "verdict", "fix"])

    def to_dict(self) -> dict[str, Any]:
        return {"controller": self.controller, "passed": self.passed, "findings": [vars(f) for f in self.findings]}

    def __str__(self) -> str:
        wide = max(len(finding.test) for finding in self.findings)
        sign = {"good": " ", "warning": "!", "fault": "X"}
        lines = [
            f"review of {self.controller}: {'passed' if self.passed else 'FAILED'}, {len(self.warnings)} to look at"
        ]
        for finding in self.findings:
            lines.append(f"{sign[finding.verdict]} {finding.test:<{wide}}  {finding.result}")
            if finding.verdict != "good" and finding.fix:
                lines.append(f"  {'':<{wide}}  -> {finding.fix}")
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(f.test)}</td><td>{escape(f.result)}</td><td>{f.verdict}</td>"
            f"<td>{escape(f.fix) if f.verdict != 'good' else ''}</td></tr>"
            for f in self.findings
        )
        head = "".join(f"<th>{word}</th>" for word in ("test", "result", "verdict", "suggested fix"))
        return f"<table><caption>review of {escape(self.controller)}</caption><tr>{head}</tr>{rows}</table>"


def review(
    system: control.StateSpace,
    controller: Controller,
    *,
    known: Known | None = None,
    robust: RobustMargins | None = None,
    lag: int = 0,
) -> Review:
    """Look through a controller with the linear model that it was designed on.

    Parameters
    ----------
    system: continuous, as three_state(plant) gives it. controller: with a linear law.
    known: friction, noise and the like; tests that need what is not known are left out.
    robust: this controller's margins over other plants, see robust_margins; without it the worst case is not judged.
    lag: whole samples between a measurement and its current.

    Raises InputError for margins of another controller, and as analyse_loop does.
    """
    if robust is not None and robust.controller != controller.name:
        raise InputError(
            f"robust has the margins of {robust.controller}, the review is of {controller.name}; expected "
            f"robust_margins(systems, controller) with this controller"
        )
    facts = known or Known()
    loop = analyse_loop(system, controller, lag=lag, noise=facts.noise)
    case = Case(system, controller, facts, loop, robust, lag)
    findings = [finding for test in TESTS for finding in test(case)]
    return Review(controller.name, tuple(findings), loop)
