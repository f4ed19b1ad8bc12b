"""Effect of a diagnosis on a closed loop: a scenario on the nominal and on the improved plant, and the closed-loop gap
of a log that was recorded in this scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.result import as_dict
from ..plant.file import label, symbol_of
from .closed_loop_replay import ClosedLoopReplay, LoopCase, held_out_samples, replay_loop
from .logged_reference import sampled_by

if TYPE_CHECKING:
    from ..core.log import Log
    from ..plant.plant import Plant
    from ..scenario.prepare import PreparedScenario
    from ..simulation.closed_loop import ClosedLoop
    from .diagnosis import Diagnosis


@dataclass(frozen=True)
class LoopComparison:
    """A scenario with one controller on the plants of a diagnosis.

    Attributes
    ----------
    scenario, controller: names.
    metrics: plant -> metric -> value, SI units. Plants: "believed" (nominal) and, if a cause was named, "improved"; or
        "before" and "after" if two logs were compared.
    failures: plant -> exceeded limits of scenario and plant, in sentences.
    replay: the closed-loop gap, if the log was recorded in this scenario.
    loops: plant -> simulation.
    units: metric -> SI unit.
    """

    scenario: str
    controller: str
    metrics: Mapping[str, Mapping[str, float]]
    failures: Mapping[str, tuple[str, ...]]
    replay: ClosedLoopReplay | None = None
    loops: Mapping[str, ClosedLoop] = field(default_factory=dict, repr=False)
    units: Mapping[str, str] = field(default_factory=dict, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Content of closed_loop.json, SI units."""
        replay, gaps = self.replay, {}
        if replay is not None:
            # The nominal plant and the improved one, by the names that they have here.
            gaps = dict(zip(self.metrics, (replay.gap["nominal"], replay.improved_gap), strict=False))
        return as_dict(
            self, "scenario controller failures", plants=list(self.metrics),
            metrics={
                name: {**{word: values[name] for word, values in self.metrics.items()}, "unit": unit}
                for name, unit in self.units.items()
            },
            passed={word: not reasons for word, reasons in self.failures.items()},
            replay=replay
            and as_dict(replay, "seconds", gap=gaps, current_not_of_this_loop=replay.drive_difference),
        )  # fmt: skip


def check_replay(case: PreparedScenario, nominal: Plant, log: Log) -> None:
    """Raises InputError if the log can't have been recorded in this scenario."""
    sampled_by(log, case.controller)
    for symbol, value in _settings(case, nominal).items():
        if not np.isclose(nominal[symbol], value, rtol=1e-9, atol=0.0):
            raise InputError(
                f"--replay: {label(symbol)} is {value:g} in scenario {case.scenario.name} and {nominal[symbol]:g} in "
                "the plant of the log; give both the same value with --set"
            )


def compare_loops(
    case: PreparedScenario,
    found: Diagnosis,
    *,
    replay: bool = False,
    words: tuple[str, str] = ("believed", "improved"),
) -> LoopComparison:
    """Run the scenario on the plants of a diagnosis; with `replay`, compare the log with these runs.

    words: names of the nominal plant and of the one with the causes.

    Raises SimulationError if a run stops although no limit of the plant is exceeded.
    """
    settings = _settings(case, found.plant)
    plants = {words[0]: found.plant.set(**settings)}
    if found.improved is not None:
        # A load that is a cause of the diagnosis is kept in the scenario.
        kept = {name: value for name, value in settings.items() if found.improved[name] == found.plant[name]}
        plants[words[1]] = found.improved.set(**kept)
    loops = {word: case.simulate(plant) for word, plant in plants.items()}
    evaluated = {word: case.evaluate(loop, every_metric=True) for word, loop in loops.items()}
    return LoopComparison(
        case.scenario.name,
        case.controller.name,
        {word: one.metrics for word, one in evaluated.items()},
        {word: one.failures for word, one in evaluated.items()},
        replay_scenario(case, found)[0] if replay else None,
        loops,
        case.metric_units,
    )


def replay_scenario(case: PreparedScenario, found: Diagnosis) -> tuple[ClosedLoopReplay, list[str]]:
    """The log compared with simulations of the scenario in which it was recorded, and findings."""
    definition, log = case.scenario.definition, sampled_by(found.log, case.controller)
    noiseless = definition.model_copy(update={"sensors": definition.sensors.model_copy(update={"noise": False})})
    quiet, settings = replace(case, scenario=replace(case.scenario, definition=noiseless)), _settings(case, found.plant)

    def run(plant: Plant, lag: int, seed: int | None) -> ClosedLoop:
        kept = {name: value for name, value in settings.items() if plant[name] == found.plant[name]}
        return (quiet if seed is None else case).simulate(plant.set(**kept), seed)

    time = case.controller.sample_time * np.arange(len(log))
    reference = definition.reference.signal(time[time <= definition.duration + 1e-9])
    scored = held_out_samples(found, log)
    return replay_loop(found, LoopCase(case.controller, log, reference, scored, run, definition.sensors.lag))


def _settings(case: PreparedScenario, plant: Plant) -> dict[str, float]:
    """Parameters of the plant that the scenario sets, SI units."""
    names = map(symbol_of, case.scenario.definition.all_settings)
    return {name: case.nonlinear[name] for name in names if name in plant.parameters}
