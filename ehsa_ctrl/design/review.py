"""Design review before simulation: stability, steady-state error, scaling, solver time and effects of friction.

Each finding has a verdict and a suggested fix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.controller_interface import Controller
from ..core.errors import InputError, choices
from ..core.result import Result, as_dict, as_table
from .analysis.loop import LoopAnalysis, analyse_loop
from .review_checks import CHECKS, Known, ReviewContext, ReviewFinding, Verdict

if TYPE_CHECKING:
    import control
    import pandas

    from .analysis.robustness import RobustMargins

__all__ = ["Known", "Review", "ReviewFinding", "Verdict", "review"]


@dataclass(frozen=True, repr=False)
class Review(Result):
    """The findings of a design review.

    Attributes
    ----------
    controller: its name.
    findings: in the order of the checks. loop: the loop analysis that they use.
    """

    controller: str
    findings: tuple[ReviewFinding, ...]
    loop: LoopAnalysis

    @property
    def passed(self) -> bool:
        """Whether no finding is a fault."""
        return all(finding.verdict != "fault" for finding in self.findings)

    @property
    def warnings(self) -> tuple[ReviewFinding, ...]:
        """Faults, then warnings."""
        bad = [finding for finding in self.findings if finding.verdict != "good"]
        return tuple(sorted(bad, key=lambda finding: finding.verdict != "fault"))

    def __getitem__(self, test: str) -> ReviewFinding:
        """A finding by the name of its check. Raises InputError for a check that the review lacks."""
        for finding in self.findings:
            if finding.test == test:
                return finding
        raise InputError(f"the review made no test {test!r}; {choices(test, [f.test for f in self.findings])}")

    def to_pandas(self) -> pandas.DataFrame:
        """One row per check: result, verdict, fix."""
        return as_table(self.findings, "result verdict fix", index="test")

    def to_dict(self) -> dict[str, Any]:
        """One of `reviews` in analysis.json."""
        return as_dict(self, "controller passed findings")

    def __str__(self) -> str:
        width = max(len(finding.test) for finding in self.findings)
        sign = {"good": " ", "warning": "!", "fault": "X"}
        lines = [
            f"review of {self.controller}: {'passed' if self.passed else 'FAILED'}, {len(self.warnings)} to look at"
        ]
        for finding in self.findings:
            lines.append(f"{sign[finding.verdict]} {finding.test:<{width}}  {finding.result}")
            if finding.verdict != "good" and finding.fix:
                lines.append(f"  {'':<{width}}  -> {finding.fix}")
        return "\n".join(lines)


def review(
    system: control.StateSpace,
    controller: Controller,
    *,
    known: Known | None = None,
    robust: RobustMargins | None = None,
    lag: int = 0,
) -> Review:
    """Review a controller on the linear model that it was designed for.

    Parameters
    ----------
    system: continuous, as three_state(plant) returns it. controller: with a linear law.
    known: friction, noise and other facts; a check without its facts is left out.
    robust: this controller's margins over many plants, for the worst-case check.
    lag: whole samples between a measurement and its current.

    Raises InputError for margins of another controller, and as `analyse_loop` does.
    """
    if robust is not None and robust.controller != controller.name:
        raise InputError(
            f"robust has the margins of {robust.controller}, the review is of {controller.name}; expected "
            f"robust_margins(systems, controller) with this controller"
        )
    known = known or Known()
    loop = analyse_loop(system, controller, lag=lag, noise=known.noise)
    context = ReviewContext(system, controller, known, loop, robust, lag)
    return Review(controller.name, tuple(finding for check in CHECKS for finding in check(context)), loop)
