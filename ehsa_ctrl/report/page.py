"""The page of scenarios: verdict first, then each scenario, at the end what the numbers rest on."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ..core.errors import InputError
from ..core.unit import factor
from ..design.analysis.loop import LoopAnalysis
from ..scenario.metrics import METRICS
from ..scenario.result import LimitCheck, ScenarioResult, first_reasons, gap
from .document import anchors, embedded, image, merged_versions, write_document
from .figures import loop_figure, scenario_figure, to_svg
from .grounds import assumed_of, hashes
from .number import number, quantity, unit
from .swing import SwingTable

#: Metrics in the table of all runs; the scenario's own section has all of them.
SHOWN = (
    "RiseTime", "SettlingTime", "Overshoot", "SteadyStateError", "MaxError", "RMSError", "Slips", "StickShare",
    "CurrentRMS",
)  # fmt: skip


#: A verdict in words, and the class of its colour.
SAID = {"pass": ("✓ passed", "good"), "fail": ("✗ failed", "bad"), "untested": ("– untested", "soft")}


def write_page(results: Sequence[ScenarioResult], folder: Path, *, command: str, drawings: Sequence[str] = ()) -> Path:
    """Write `report.html` to the folder and return its path; the same results give the same bytes.

    Parameters
    ----------
    results: in the order in which they are shown; those of one scenario share a section.
    command: the command line that made them, for the page's end.
    drawings: the SVG of each result's figure, in their order, where they were drawn already.

    Raises InputError if there is no result.
    """
    if not results:
        raise InputError("there is no result to report; run at least one scenario")
    names = anchors(f"run-{result.scenario.name}-{result.controller.name}" for result in results)
    loops = _loops(results)
    failed = [(result, anchor) for result, anchor in zip(results, names, strict=True) if not result.passed]
    runs = [run.trajectory for result in results for run in (result.nonlinear, result.linear)]
    return write_document(
        "page.html.j2",
        folder,
        {"breakable": breakable},
        results=results,
        failed=failed,
        passed=len(results) - len(failed),
        columns=[name for name in SHOWN if any(_exists(result, name) for result in results)],
        metrics=METRICS,
        shown=shown,
        cell=cell,
        first_reasons=first_reasons,
        said=lambda result: SAID[result.verdict][0],
        mood=lambda result: SAID[result.verdict][1],
        beside=beside,
        summary=list(zip(results, names, strict=True)),
        scenarios=_scenarios(results, names, loops, drawings or [""] * len(results)),
        loops=list(loops.values()),
        doubtful=[
            (result, anchor, table.sentence[0])
            for result, anchor in zip(results, names, strict=True)
            if result.sensitivities and not (table := SwingTable(result, result.sensitivities)).sentence[1]
        ],
        tried=[result for result in results if result.sensitivities],
        files=hashes(file for result in results for file in result.files),
        versions=merged_versions(result.nonlinear.trajectory.provenance for result in results),
        assumed=assumed_of(run.plant for run in runs),
        command=command,
    )


def shown(metric: str, value: float) -> str:
    """A metric's SI value as a number in the unit that a person reads."""
    return number(value / factor(METRICS[metric].shown, METRICS[metric].unit))


def cell(result: ScenarioResult, metric: str, value: float) -> str:
    """The same of a run, or that its reference does not define it."""
    return "not defined" if result.scenario.definition.undefined(metric) else shown(metric, value)


@dataclass(frozen=True)
class Loop:
    """A controller's linear loop: shown once, however many scenarios it ran."""

    analysis: LoopAnalysis
    controller: Any
    plant: str
    anchor: str

    @property
    def about(self) -> str:
        """The controller in its own words, if it has any."""
        return str(self.controller) if "__str__" in vars(type(self.controller)) else ""

    @property
    def figure(self) -> Markup:
        words = (
            f"Bode plot of the open loop with {self.analysis.controller}, its margins, and |S| and |T|. {self.sentence}"
        )
        return embedded(loop_figure(self.analysis), words)

    @property
    def sentence(self) -> str:
        loop = self.analysis
        return (
            f"Crossover {quantity(loop.crossover, 'rad/s')}, phase margin {number(loop.phase_margin)}°, gain margin "
            f"{number(loop.gain_margin)}, delay margin {_milli(loop.delay_margin)}, Ms {number(loop.Ms)}, "
            f"Mt {number(loop.Mt)}; the linear closed loop is {'stable' if loop.stable else 'NOT STABLE'}."
        )

    @property
    def rows(self) -> list[tuple[str, str, str, str]]:
        """Name, value, unit, meaning."""
        loop = self.analysis
        return [
            ("crossover", number(loop.crossover), "rad/s", "frequency at which the loop gain is 1"),
            ("phase margin", number(loop.phase_margin), "°", "lag at the crossover that brings the loop to the brink"),
            ("gain margin", number(loop.gain_margin), "", "factor on the gain that brings it there"),
            ("delay margin", number(1e3 * loop.delay_margin), "ms", "delay that brings it there"),
            ("Ms", number(loop.Ms), "", "peak of |S|: the largest amplification of a disturbance"),
            ("Mt", number(loop.Mt), "", "peak of |T|: the largest amplification of reference and noise"),
        ]


@dataclass(frozen=True)
class Run:
    """One scenario with one controller, as its section shows it."""

    result: ScenarioResult
    anchor: str
    loop: Loop | None
    drawing: str = ""

    @property
    def figure(self) -> Markup:
        result = self.result
        words = (
            f"Signals over time of {result.scenario.name} with {result.controller.name}: position with its reference, "
            "error, speed, pressures and current, linear prediction and nonlinear plant. Largest error on the "
            f"nonlinear plant {_with_unit('MaxError', result.metrics['MaxError'][1])}; the rod sticks for "
            f"{_with_unit('StickShare', result.metrics['StickShare'][1])} of the run."
        )
        drawing = self.drawing or to_svg(scenario_figure(result))
        return image(drawing.encode(), "svg+xml", words)

    @property
    def swings(self) -> SwingTable | None:
        """Its metrics over the ranges of assumed parameters, where these were tried."""
        return None if self.result.sensitivities is None else SwingTable(self.result, self.result.sensitivities)

    @property
    def limits(self) -> list[tuple[LimitCheck, str]]:
        """Each limit with its bounds in words."""
        return [(check, _bounds(check)) for check in self.result.limit_checks]

    @property
    def comparison(self) -> list[tuple[str, ...]]:
        """Metric, linear prediction, nonlinear outcome, their gap, unit and meaning; without what never happened."""
        return [
            (name, *(cell(self.result, name, value) for value in (*pair, gap(*pair))), *_about(name))
            for name, pair in self.result.metrics.items()
            if _exists(self.result, name)
        ]

    @property
    def saturates(self) -> bool:
        """The controller asked for all the current that it may, so that the figure shows its limit."""
        limit = float(getattr(self.result.controller, "current_limit", math.inf))
        return bool((abs(self.result.nonlinear.asked) >= limit * (1 - 1e-9)).any())

    @property
    def facts(self) -> list[tuple[str, str]]:
        """What was run, whatever the controller."""
        definition = self.result.scenario.definition
        changes = ", ".join(f"{key} = {value}" for key, value in definition.all_settings.items())
        given = ", ".join(f"{key} = {value}" for key, value in self.result.settings.items())
        forces = ", ".join(
            f"{quantity(step.force, 'N')} from {quantity(step.start, 's')}"
            + (f" for {quantity(step.duration, 's')}" if step.duration != float("inf") else " to the end")
            for step in definition.disturbance
        )
        faults = ", ".join(_fault(fault) for fault in definition.fault)
        baseline = self.result.baseline
        plant = self.result.plant
        return [
            ("plant", f"{plant.name}: {plant.title}"),
            ("set in this scenario", changes or "nothing; the plant as its file has it"),
            *([("set for this run alone", given)] if given else []),
            ("force on the rod", forces or "none"),
            ("faults", faults or "none"),
            ("duration", quantity(definition.duration, "s")),
            ("baseline", f"recorded because: {baseline.reason}" if baseline else "none"),
        ]


def beside(runs: Sequence[Run]) -> list[tuple[str, list[str], str]]:
    """Metric, its value on the nonlinear plant with each controller, and its unit; without what never happened."""
    return [
        (name, [cell(run.result, name, run.result.metrics[name][1]) for run in runs], unit(METRICS[name].shown))
        for name in METRICS
        if any(_exists(run.result, name) for run in runs)
    ]


def _about(metric: str) -> tuple[str, str]:
    return unit(METRICS[metric].shown), METRICS[metric].meaning


def _fault(fault: Any) -> str:
    """A fault in words."""
    what = {"stuck": "stuck", "lost": "lost"}.get(fault.kind)
    words = f"{fault.channel} {what}" if what else f"drive limited to {quantity(fault.current, 'A')}"
    lasting = "" if fault.duration == float("inf") else f" for {quantity(1e3 * fault.duration, 'ms')}"
    return f"{words} from {quantity(fault.start, 's')}{lasting}"


def breakable(name: str) -> Markup:
    """A metric's name that may break between its words: SteadyStateError."""
    return Markup("<wbr>").join(re.split(r"(?<=[a-z])(?=[A-Z])", name))


def _with_unit(metric: str, value: float) -> str:
    return f"{shown(metric, value)} {unit(METRICS[metric].shown)}".rstrip()


def _milli(seconds: float) -> str:
    return quantity(1e3 * seconds, "ms")


def _bounds(judgement: LimitCheck) -> str:
    words = (("at least", judgement.lower), ("at most", judgement.upper))
    parts = [f"{word} {shown(judgement.metric, bound)}" for word, bound in words if bound is not None]
    return f"{' and '.join(parts)} {unit(METRICS[judgement.metric].shown)}".rstrip()


def _exists(result: ScenarioResult, metric: str) -> bool:
    """Whether there is something to say of a metric, if only that it is not defined here."""
    known = not all(math.isnan(value) for value in result.metrics[metric])
    return known or bool(result.scenario.definition.undefined(metric))


def _scenarios(
    results: Sequence[ScenarioResult], names: Sequence[str], loops: Mapping[str, Loop], drawings: Sequence[str]
) -> list[list[Run]]:
    """Runs of the same scenario together, in the order in which the scenarios came."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for result, anchor, drawing in zip(results, names, drawings, strict=True):
        loop = loops[_loop_key(result)] if result.loop is not None else None
        key = result.scenario.name, str(result.scenario.path)
        groups.setdefault(key, []).append(Run(result, anchor, loop, drawing))
    return list(groups.values())


def _loop_key(result: ScenarioResult) -> str:
    """The same for runs that share a loop: controllers from two folders can have one name and be different."""
    figures = result.loop.to_dict() if result.loop is not None else {}
    return f"{result.controller.name} {result.plant.name} {figures}"


def _loops(results: Sequence[ScenarioResult]) -> dict[str, Loop]:
    """Each controller's loop on each plant, by `_loop_key`."""
    first = {_loop_key(result): result for result in reversed(results) if result.loop is not None}
    keys = [key for key in dict.fromkeys(map(_loop_key, results)) if key in first]
    names = anchors(f"loop-{first[key].controller.name}-{first[key].plant.name}" for key in keys)
    loops = {}
    for key, name in zip(keys, names, strict=True):
        analysis = first[key].loop
        assert analysis is not None
        loops[key] = Loop(analysis, first[key].controller, first[key].plant.name, name)
    return loops
