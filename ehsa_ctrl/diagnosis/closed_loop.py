"""What a diagnosis means for a closed loop: a scenario on the nominal and the improved plant, and the gap of a log to
runs of the loop under which it was recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.controller_interface import MEASURED
from ..core.errors import InputError
from ..core.result import as_dict
from ..plant.file import label, symbol_of
from ..scenario.metrics import METRICS
from ..scenario.result import failures_of
from .signals import gap, scored, signal_noise

if TYPE_CHECKING:
    from ..core.log import Log
    from ..plant.plant import Plant
    from ..scenario.prepare import PreparedScenario
    from ..simulation.closed_loop import ClosedLoop
    from .diagnosis import Diagnosis


@dataclass(frozen=True)
class LoopReplay:
    """A log compared with runs of the same loop.

    gap: plant -> signal -> gap over `seconds`, all that log and scenario have in common.
    other: RMS of the logged current minus what the controller asks for on the log's own measurements, over that
        current's standard deviation; nan where the log lacks what the controller reads.
    """

    gap: Mapping[str, Mapping[str, float]]
    seconds: float
    other: float


@dataclass(frozen=True)
class LoopComparison:
    """A scenario with one controller on the plants of a diagnosis.

    Attributes
    ----------
    scenario, controller: names.
    metrics: plant ("believed", "improved" where a cause was named; "before", "after" where two logs were compared) ->
        metric -> value, SI units.
    failures: plant -> limits of the scenario and of the plant that were exceeded, in sentences.
    replay: the closed-loop gap, where the log was recorded under this loop.
    loops: plant -> its run.
    """

    scenario: str
    controller: str
    metrics: Mapping[str, Mapping[str, float]]
    failures: Mapping[str, tuple[str, ...]]
    replay: LoopReplay | None = None
    loops: Mapping[str, ClosedLoop] = field(default_factory=dict, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Content of closed_loop.json, SI units."""
        replay = self.replay
        return as_dict(
            self, "scenario controller failures", plants=list(self.metrics),
            metrics={
                name: {**{word: values[name] for word, values in self.metrics.items()}, "unit": METRICS[name].unit}
                for name in METRICS
            },
            passed={word: not reasons for word, reasons in self.failures.items()},
            replay=replay and as_dict(replay, "gap seconds", current_not_of_this_loop=replay.other),
        )  # fmt: skip


def check_replay(case: PreparedScenario, nominal: Plant, log: Log) -> None:
    """Raises InputError for a log that can't have been recorded under this loop."""
    dt = case.controller.sample_time
    where = log.path or "the log"
    if abs(log.sample_time / dt - 1.0) > 1e-3:
        raise InputError(
            f"{where}: is sampled every {log.sample_time:g} s, controller {case.controller.name} every {dt:g} s; leave "
            "--replay out, or give the log that this loop recorded"
        )
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

    Raises SimulationError for a run that could not be finished though no limit of the plant was passed.
    """
    settings = _settings(case, found.plant)
    plants = {words[0]: found.plant.set(**settings)}
    if found.improved is not None:
        # A load that the diagnosis found acts in the scenario too.
        kept = {name: value for name, value in settings.items() if found.improved[name] == found.plant[name]}
        plants[words[1]] = found.improved.set(**kept)
    loops = {word: case.simulate(plant) for word, plant in plants.items()}
    metrics = {word: case.metrics(loop) for word, loop in loops.items()}
    expected = case.scenario.definition.expect_trips
    failures = {
        word: failures_of(case.check_limits(metrics[word]), loop.trajectory, expected) for word, loop in loops.items()
    }
    return LoopComparison(
        case.scenario.name,
        case.controller.name,
        metrics,
        failures,
        _replay(case, plants, found) if replay else None,
        loops,
    )


def _settings(case: PreparedScenario, plant: Plant) -> dict[str, float]:
    """Parameters that the scenario sets, as far as this model of the plant has them, SI units."""
    names = map(symbol_of, case.scenario.definition.all_settings)
    return {name: case.nonlinear[name] for name in names if name in plant.parameters}


def _replay(case: PreparedScenario, plants: Mapping[str, Plant], found: Diagnosis) -> LoopReplay:
    log, definition = found.log, case.scenario.definition
    quiet = definition.model_copy(update={"sensors": definition.sensors.model_copy(update={"noise": False})})
    silent = replace(case, scenario=replace(case.scenario, definition=quiet))
    loops = {word: silent.simulate(plant) for word, plant in plants.items()}
    n = min(len(log), *(loop.asked.size for loop in loops.values()))
    dt = log.sample_time
    signals = found.plant.structure.system.scored
    measured = scored(signals, {name: values[:n] for name, values in log.channels.items()}, dt)
    noise = signal_noise(signals, found.noise_sd, dt)
    gaps = {}
    for word, loop in loops.items():
        simulated = dict(zip(MEASURED, loop.measured[:n].T, strict=True))
        gaps[word] = gap(measured, scored(signals, simulated, dt), noise)
    reference = next(iter(loops.values())).reference[:n]
    return LoopReplay(gaps, (n - 1) * dt, _current_difference(case, log, reference))


def _current_difference(case: PreparedScenario, log: Log, reference: np.ndarray) -> float:
    """Relative difference between the logged current and what this controller asks for on the measurements."""
    n, lag = len(reference), case.scenario.definition.sensors.lag
    spread = float(np.std(log["current"][:n]))
    if spread == 0.0 or any(name not in log.channels for name in MEASURED):
        return float("nan")
    rows = np.column_stack([log[name][:n] for name in MEASURED])
    controller, memory = case.controller, case.controller.initial_memory()
    compiled, settings = controller.compiled, controller.settings()
    asked = np.array(
        [
            controller.step(r, m, memory) if compiled is None else compiled(r, m, memory, settings)
            for r, m in zip(reference, rows, strict=True)
        ]
    )
    return float(np.sqrt(np.mean((log["current"][lag:n] - asked[: n - lag]) ** 2))) / spread
