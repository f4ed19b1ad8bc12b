"""Run a scenario: design on the identified linear model, simulate on the nonlinear plant, compare, check limits."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..core.controller_interface import Controller
from ..design.analysis.loop import analyse_loop
from ..design.controller import SampledController
from ..plant.plant import Plant
from .baseline_file import baseline_path, read_baseline
from .definition import Scenario
from .metrics import METRICS
from .prepare import prepare
from .result import ScenarioResult
from .sensitivity import assumption_sensitivity


def run(
    scenario: str | Path | Scenario,
    *,
    controller: str | Path | Controller | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    assumed: bool | None = False,
    settings: Mapping[str, str | float] | None = None,
) -> ScenarioResult:
    """Run a scenario: linear prediction, nonlinear check, comparison, limits.

    The controller is designed on the identified linear set of the plant's file; the scenario's load, disturbances and
    faults act in both runs.

    Parameters
    ----------
    scenario: a name, a path, or a loaded scenario. Files that it names are looked for beside its own file first.
    controller, plant: replace those that the scenario names. A designed controller, from `load_controller` or a
        user's own, runs as it is and is compared with no baseline. A loaded, changed or identified plant is used as it
        is, with the scenario's load and settings; the controller is designed on the linear set of its file.
    design: plant whose linear set is used for design and prediction, if it differs from the plant that is simulated:
        the rig's identified model against the plant that counts as true.
    assumed: also run with each assumed parameter at both ends of its range; None: only with a compiled controller,
        where this is quick.
    settings: parameters of the simulated plant in this run, as for `load_plant`, in addition to the scenario's own:
        {"K_T": 1.1, "load.stiffness": "50 N/mm"}. A load acts in the prediction too; the controller and the rest of
        the prediction keep the linear set. Such a run is compared with no baseline.

    Raises
    ------
    InputError: a definition is wrong or refers to something that does not exist.
    SimulationError: a run stops although no limit of the plant was exceeded.
    """
    begun = clock.perf_counter()
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    loops = [case.simulate(model) for model in (case.linear, case.nonlinear)]
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
        loop=analyse_loop(case.model, case.controller) if isinstance(case.controller, SampledController) else None,
        seconds=clock.perf_counter() - begun,
        files=case.files,
        settings=case.settings,
    )
    if assumed or (assumed is None and case.controller.compiled is not None):
        result = replace(result, sensitivities=assumption_sensitivity(case, nominal_passed=not result.limit_failures))
    # A baseline belongs to the scenario's own plant and to a controller from a file.
    recorded = not plant and not design and not settings and (controller is None or isinstance(controller, str | Path))
    path = baseline_path(result) if recorded else None
    return replace(result, baseline=read_baseline(path) if path and path.is_file() else None)
