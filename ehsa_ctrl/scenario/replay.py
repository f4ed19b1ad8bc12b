"""One run of a Monte Carlo campaign again: the same draw and sensor noise, with every result of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..core.checkpoint import read_results
from ..core.errors import InputError
from ..plant.file import key_of, symbol_of
from .outcome import Outcome
from .prepare import PreparedScenario


def worst(outcomes: Sequence[Outcome]) -> Outcome:
    """The run farthest beyond its limits; if all passed, the one closest to a limit."""
    return min(outcomes, key=lambda each: (each.passed, each.margin if each.margin == each.margin else 0.0))


def read_draw(text: str) -> Outcome:
    """The run that "FILE" or "FILE:RUN" names: the worst of a campaign's .jsonl, or the one of this number.

    Raises InputError for a file that is no campaign, and for a run that it does not hold.
    """
    name, colon, number = text.rpartition(":")
    if not (colon and number.isdigit()):
        name, number = text, ""
    path = Path(name)
    outcomes = read_results(
        path, "campaign", Outcome.from_line, wrong="is not the result of a run",
        none="is not the .jsonl of a montecarlo campaign; expected the file that it wrote",
    )  # fmt: skip
    if not outcomes:
        raise InputError(f"{path}: has no finished run; start the campaign first")
    if not number:
        return worst(outcomes)
    found = next((each for each in outcomes if each.run == int(number)), None)
    if found is None:
        last = max(each.run for each in outcomes)
        raise InputError(f"{path}: has no run {number}; expected one of 0 to {last}")
    return found


def with_draw(case: PreparedScenario, draw: Outcome) -> PreparedScenario:
    """The scenario of one run of its campaign. A drawn load acts on the linear prediction too.

    Raises InputError for a draw of parameters that the plant does not have.
    """
    sensors = case.scenario.definition.sensors.model_copy(update={"seed": draw.seed})
    definition = case.scenario.definition.model_copy(update={"sensors": sensors})
    try:
        nonlinear = case.nonlinear.set(**draw.parameters)
        loads = {name: value for name, value in draw.parameters.items() if key_of(symbol_of(name)).startswith("load.")}
        linear = case.linear.set(**loads)
    except InputError as error:
        raise InputError(f"the replayed run is of another scenario or plant: {error}") from None
    return replace(
        case,
        scenario=replace(case.scenario, definition=definition),
        linear=linear,
        nonlinear=nonlinear,
        settings={**case.settings, **draw.parameters},
    )
