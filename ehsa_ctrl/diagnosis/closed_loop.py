"""Effect of a diagnosis on a closed loop: a scenario on the nominal and on the improved plant, and the closed-loop gap
of a log that was recorded under this loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.controller_interface import MEASURED
from ..core.errors import InputError
from ..core.result import as_dict
from ..plant.file import label, symbol_of
from .signals import gap, scored_signals, signal_noise

if TYPE_CHECKING:
    from ..core.log import Log
    from ..plant.plant import Plant
    from ..scenario.prepare import PreparedScenario
    from ..simulation.closed_loop import ClosedLoop
    from .diagnosis import Diagnosis


@dataclass(frozen=True)
class LoopReplay:
    """A log compared with simulations of the same closed loop.

    gap: plant -> signal -> gap. seconds: time that log and scenario have in common [s].
    current_difference: RMS difference between the logged current and the controller's output on the logged
        measurements, divided by the standard deviation of the logged current; nan if the log lacks a measurement.
    """

    gap: Mapping[str, Mapping[str, float]]
    seconds: float
    current_difference: float


@dataclass(frozen=True)
class LoopComparison:
    """A scenario with one controller on the plants of a diagnosis.

    Attributes
    ----------
    scenario, controller: names.
    metrics: plant -> metric -> value, SI units. Plants: "believed" (nominal) and, if a cause was named, "improved"; or
        "before" and "after" if two logs were compared.
    failures: plant -> exceeded limits of scenario and plant, in sentences.
    replay: the closed-loop gap, if the log was recorded under this loop.
    loops: plant -> simulation.
    units: metric -> SI unit.
    """

    scenario: str
    controller: str
    metrics: Mapping[str, Mapping[str, float]]
    failures: Mapping[str, tuple[str, ...]]
    replay: LoopReplay | None = None
    loops: Mapping[str, ClosedLoop] = field(default_factory=dict, repr=False)
    units: Mapping[str, str] = field(default_factory=dict, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Content of closed_loop.json, SI units."""
        replay = self.replay
        return as_dict(
            self, "scenario controller failures", plants=list(self.metrics),
            metrics={
                name: {**{word: values[name] for word, values in self.metrics.items()}, "unit": unit}
                for name, unit in self.units.items()
            },
            passed={word: not reasons for word, reasons in self.failures.items()},
            replay=replay and as_dict(replay, "gap seconds", current_not_of_this_loop=replay.current_difference),
        )  # fmt: skip


def check_replay(case: PreparedScenario, nominal: Plant, log: Log) -> None:
    """Raises InputError if the log can't have been recorded under this loop."""
    dt = case.controller.sample_time
    where = log.path or "the log"
    if abs(log.sample_time / dt - 1.0) > 1e-3:
        raise InputError(
            f"{where}: has a sample time of {log.sample_time:g} s, controller {case.controller.name} of {dt:g} s; omit "
            "--replay, or give a log recorded under this loop"
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
        _replay(case, plants, found) if replay else None,
        loops,
        case.metric_units,
    )


def _settings(case: PreparedScenario, plant: Plant) -> dict[str, float]:
    """Parameters of the plant that the scenario sets, SI units."""
    names = map(symbol_of, case.scenario.definition.all_settings)
    return {name: case.nonlinear[name] for name in names if name in plant.parameters}


def _replay(case: PreparedScenario, plants: Mapping[str, Plant], found: Diagnosis) -> LoopReplay:
    """The log compared with simulations of the loop without sensor noise."""
    log, definition = found.log, case.scenario.definition
    quiet = definition.model_copy(update={"sensors": definition.sensors.model_copy(update={"noise": False})})
    noiseless = replace(case, scenario=replace(case.scenario, definition=quiet))
    loops = {word: noiseless.simulate(plant) for word, plant in plants.items()}
    n = min(len(log), *(loop.asked.size for loop in loops.values()))
    dt = log.sample_time
    signals = found.plant.structure.system.scored
    measured = scored_signals(signals, {name: values[:n] for name, values in log.channels.items()}, dt)
    noise = signal_noise(signals, found.noise_sd, dt)
    gaps = {}
    for word, loop in loops.items():
        simulated = dict(zip(MEASURED, loop.measured[:n].T, strict=True))
        gaps[word] = gap(measured, scored_signals(signals, simulated, dt), noise)
    reference = next(iter(loops.values())).reference[:n]
    return LoopReplay(gaps, (n - 1) * dt, _current_difference(case, log, reference))


def _current_difference(case: PreparedScenario, log: Log, reference: np.ndarray) -> float:
    """See `LoopReplay.current_difference`."""
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
