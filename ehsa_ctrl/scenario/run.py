"""Run a scenario: design on the linear model, predict, check on the nonlinear plant, compare, evaluate limits."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.errors import InputError
from ..design.analysis.loop import analyse_loop
from ..design.controller import has_linear_law
from ..plant.plant import Plant
from .baseline_file import baseline_path, read_baseline
from .comparison import ControllerComparison
from .definition import Scenario
from .metrics import METRICS
from .outcome import Outcome
from .prepare import prepare
from .replay import with_draw
from .result import ScenarioResult
from .sensitivity import assumption_sensitivity


def run(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    controller: Any = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
    draw: Outcome | None = None,
) -> ScenarioResult | ControllerComparison:
    """Run a scenario: linear prediction, nonlinear check, comparison, limits.

    The controller is designed on the linear parameter set of the plant's file. The scenario's load, disturbances and
    faults act on both the linear and the nonlinear run.

    Parameters
    ----------
    scenario: name, path, loaded scenario, or a dictionary as for `load_scenario`. Files that it names are searched
        beside its own file first.
    controller, plant: replace those of the scenario. A controller is all that `load_controller` takes, or what it
        gives; a list of several gives a table of their runs. Without a current limit of its own it has the plant's
        rating. Only a controller by name or path is compared with a baseline. A plant object is used unchanged apart
        from the scenario's load and settings; the controller is still designed on the linear set of its file.
    design: plant whose linear set is used for design and prediction if it differs from the simulated plant, for
        instance the identified model while the simulated plant stands for the rig.
    assumed: also run with each assumed parameter at both ends of its range; None: only for compiled controllers, for
        which this is quick.
    settings: parameters of the simulated plant in this run, as for `load_plant`, in addition to the scenario's own:
        {"K_T": 1.1, "load.stiffness": "50 N/mm"}. A load acts on the prediction too; controller and prediction
        otherwise keep the linear set. Such a run is not compared with a baseline.
    draw: a run of `monte_carlo` with the same scenario and plant, such as its `worst`, to be repeated to the last bit:
        its parameters and its sensor noise.

    Returns
    -------
    The result; with a list of controllers a ControllerComparison, indexed by name or position.

    Raises
    ------
    InputError: a definition is invalid or refers to something that does not exist.
    SimulationError: a run stops although no plant limit was exceeded.
    """
    options: dict[str, Any] = {"plant": plant, "design": design, "assumed": assumed, "settings": settings, "draw": draw}
    if not isinstance(controller, list | tuple):
        return run_one(scenario, controller, **options)
    if not controller:
        raise InputError("controller is an empty list; give at least one")
    results = [run_one(scenario, each, **options) for each in controller]
    names = [result.controller.name for result in results]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(
            f"several controllers are named {twice[0]!r}; name them by load_controller(..., label=...) so that the "
            "table can tell them apart"
        )
    return ControllerComparison(tuple(results))


def run_one(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    controller: Any = None,
    *,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
    draw: Outcome | None = None,
) -> ScenarioResult:
    """Run a scenario with one controller; arguments and errors as of `run`."""
    begun = clock.perf_counter()
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    if draw is not None:
        case = with_draw(case, draw)
    loops = [case.simulate(model) for model in (case.linear, case.nonlinear)]
    # One run may stop early; both are compared over the same time.
    loops = [loop.first(min(len(other.trajectory) for other in loops)) for loop in loops]
    predicted, outcome = (case.metrics(loop) for loop in loops)
    result = ScenarioResult(
        scenario=case.scenario,
        controller=case.controller,
        linear=loops[0],
        nonlinear=loops[1],
        metrics={name: (predicted[name], outcome[name]) for name in METRICS},
        limit_checks=case.check_limits(outcome),
        trips=loops[1].trajectory.exceeded,
        loop=analyse_loop(case.model, case.controller) if has_linear_law(case.controller) else None,
        seconds=clock.perf_counter() - begun,
        files=case.files,
        settings=case.settings,
        draw=draw,
    )
    if assumed or (assumed is None and case.controller.compiled is not None):
        result = replace(result, sensitivities=assumption_sensitivity(case, nominal_passed=not result.limit_failures))
    # A baseline is valid only for the scenario's own plant and a controller from a file.
    comparable = not (plant or design or settings or draw) and (
        controller is None or isinstance(controller, str | Path)
    )
    path = baseline_path(result) if comparable else None
    return replace(result, baseline=read_baseline(path) if path and path.is_file() else None)
