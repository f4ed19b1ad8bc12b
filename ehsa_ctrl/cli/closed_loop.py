"""What a diagnosis means for the closed loop: a scenario on the believed and the improved plant, and the gap there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from ..core.log import Log
    from ..diagnosis.diagnosis import Diagnosis
    from ..plant.plant import Plant
    from ..scenario.run import PreparedScenario
    from ..simulation.closed_loop import ClosedLoop


@dataclass(frozen=True)
class Replay:
    """The log against runs of the same loop.

    gap: plant -> signal -> gap over `seconds`, all of what log and scenario share.
    other: RMS of the logged current minus what the controller asks for on the log's own measurements, over that
        current's standard deviation; nan where the log lacks what the controller reads.
    """

    gap: Mapping[str, Mapping[str, float]]
    seconds: float
    other: float


@dataclass(frozen=True)
class Closed:
    """A scenario with one controller on the plants of a diagnosis.

    Attributes
    ----------
    scenario, controller: names.
    metrics: plant ("believed", "improved" where a cause was named; "before", "after" where two logs were compared) ->
        metric -> value, SI units.
    failures: plant -> limits of the scenario and of the plant that were not kept, in sentences.
    replay: the closed-loop gap, where the log was recorded under this loop.
    loops: plant -> its run.
    """

    scenario: str
    controller: str
    metrics: Mapping[str, Mapping[str, float]]
    failures: Mapping[str, tuple[str, ...]]
    replay: Replay | None = None
    loops: Mapping[str, ClosedLoop] = field(default_factory=dict, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """As closed_loop.json, SI units."""
        from ..scenario.metrics import METRICS

        return {
            "scenario": self.scenario,
            "controller": self.controller,
            "plants": list(self.metrics),
            "metrics": {
                name: {**{word: values[name] for word, values in self.metrics.items()}, "unit": METRICS[name].unit}
                for name in METRICS
            },
            "passed": {word: not reasons for word, reasons in self.failures.items()},
            "failures": {word: list(reasons) for word, reasons in self.failures.items()},
            "replay": None
            if self.replay is None
            else {
                "gap": {word: dict(gaps) for word, gaps in self.replay.gap.items()},
                "seconds": self.replay.seconds,
                "current_not_of_this_loop": self.replay.other,
            },
        }


def case_of(scenario: str, controller: str | None, plant: Plant) -> PreparedScenario:
    """The scenario, its controller designed on this plant's linear set.

    Raises InputError: as `prepare`, a scenario of another system.
    """
    from ..core.catalogue import plants
    from ..plant.load import load_plant
    from ..scenario.definition import load_scenario
    from ..scenario.run import prepare
    from .output import warn

    loaded = load_scenario(scenario)
    named = load_plant(plants.find(loaded.definition.plant, beside=loaded.path))
    if named.structure.system_name != plant.structure.system_name:
        raise InputError(
            f"scenario {loaded.name} is for {named.name} ({named.structure.system_name}), the log of {plant.name} "
            f"({plant.structure.system_name}); give a scenario of that system"
        )
    if named.path is not None and plant.path is not None and named.path.resolve() != plant.path.resolve():
        warn(f"scenario {loaded.name} names plant {named.path}; here it is run on {plant.path}")
    return prepare(loaded, controller=controller, plant=plant.path)


def check_replay(case: PreparedScenario, nominal: Plant, log: Log) -> None:
    """Raises InputError for a log that can't have been recorded under this loop."""
    from ..plant.file import both

    dt = case.controller.sample_time
    where = log.path or "the log"
    if abs(log.sample_time / dt - 1.0) > 1e-3:
        raise InputError(
            f"{where}: is sampled every {log.sample_time:g} s, controller {case.controller.name} every {dt:g} s; leave "
            "--replay out, or give the log that this loop recorded"
        )
    symbols = _symbols(case, nominal)
    for symbol, value in symbols.items():
        if not np.isclose(nominal[symbol], value, rtol=1e-9, atol=0.0):
            raise InputError(
                f"--replay: {both(symbol)} is {value:g} in scenario {case.scenario.name} and {nominal[symbol]:g} as "
                "believed of the log; say the same of both with --set"
            )


def close(
    case: PreparedScenario, found: Diagnosis, *, replay: bool = False, words: tuple[str, str] = ("believed", "improved")
) -> Closed:
    """Run the scenario on the plants of a diagnosis, and compare the log with them if it is of this loop.

    words: what the plant that the log was held against and the one with its causes are called.

    Raises SimulationError for a run that could not be finished though no limit of the plant was passed.
    """
    from ..scenario.result import failures_of

    symbols = _symbols(case, found.plant)
    plants = {words[0]: found.plant.set(**symbols)}
    if found.improved is not None:
        # What the diagnosis found of the load is there in the scenario too.
        kept = {name: v for name, v in symbols.items() if found.improved[name] == found.plant[name]}
        plants[words[1]] = found.improved.set(**kept)
    loops = {word: case.simulate(plant) for word, plant in plants.items()}
    metrics = {word: case.metrics(loop) for word, loop in loops.items()}
    expected = case.scenario.definition.expect_trips
    failures = {
        word: failures_of(case.check_limits(metrics[word]), loop.trajectory, expected) for word, loop in loops.items()
    }
    return Closed(
        case.scenario.name,
        case.controller.name,
        metrics,
        failures,
        _replay(case, plants, found) if replay else None,
        loops,
    )


def _symbols(case: PreparedScenario, plant: Plant) -> dict[str, float]:
    """What the scenario believes of the plant, as far as this model of it has it, SI units."""
    from ..plant.file import symbol_of

    names = map(symbol_of, case.scenario.definition.all_settings)
    return {name: case.nonlinear[name] for name in names if name in plant.parameters}


def _replay(case: PreparedScenario, plants: Mapping[str, Plant], found: Diagnosis) -> Replay:
    from ..core.controller_interface import MEASURED
    from ..diagnosis.signals import gap, scored, signal_noise

    log, definition = found.log, case.scenario.definition
    quiet = definition.model_copy(update={"sensors": definition.sensors.model_copy(update={"noise": False})})
    silent = replace(case, scenario=replace(case.scenario, definition=quiet))
    loops = {word: silent.simulate(plant) for word, plant in plants.items()}
    n = min(len(log), *(loop.asked.size for loop in loops.values()))
    dt = log.sample_time
    measured = scored({name: values[:n] for name, values in log.channels.items()}, dt)
    noise = signal_noise(found.noise_sd, dt)
    gaps = {}
    for word, loop in loops.items():
        shown = dict(zip(MEASURED, loop.measured[:n].T, strict=True))
        gaps[word] = gap(measured, scored(shown, dt), noise)
    reference = next(iter(loops.values())).reference[:n]
    return Replay(gaps, (n - 1) * dt, _other(case, log, reference))


def _other(case: PreparedScenario, log: Log, reference: np.ndarray) -> float:
    """How far the logged current is from what this controller asks for on what was measured."""
    from ..core.controller_interface import MEASURED

    n, lag = len(reference), case.scenario.definition.sensors.lag
    spread = float(np.std(log["current"][:n]))
    if spread == 0.0 or any(name not in log.channels for name in MEASURED):
        return float("nan")
    rows = np.column_stack([log[name][:n] for name in MEASURED])
    controller, memory = case.controller, case.controller.initial_memory()
    step = controller.step
    if controller.compiled is not None:
        step = partial(_step, controller.compiled, controller.settings())
    asked = np.array([step(r, m, memory) for r, m in zip(reference, rows, strict=True)])
    return float(np.sqrt(np.mean((log["current"][lag:n] - asked[: n - lag]) ** 2))) / spread


def _step(
    compiled: Callable[..., float],
    settings: np.ndarray,
    reference: np.ndarray,
    measured: np.ndarray,
    memory: np.ndarray,
) -> float:
    return compiled(reference, measured, memory, settings)


def table(closed: Closed) -> Table:
    """What the plants make of the loop, in the units that a person reads; and the closed-loop gap below it."""
    from rich.table import Table

    from ..core.unit import factor
    from ..scenario.metrics import METRICS
    from .run import SHOWN

    words = list(closed.metrics)
    shown = Table(box=None, pad_edge=False)
    shown.add_column("")
    for word in words:
        shown.add_column(f"{word} plant", justify="right")
    shown.add_column("unit")
    for name in SHOWN:
        metric = METRICS[name]
        values = [closed.metrics[word][name] / factor(metric.shown, metric.unit) for word in words]
        if np.isfinite(values).any():
            shown.add_row(name, *(f"{value:.4g}" for value in values), "" if metric.shown == "1" else metric.shown)
    if closed.replay is not None:
        for signal in closed.replay.gap[words[0]]:
            gaps = [100.0 * closed.replay.gap[word][signal] for word in words]
            shown.add_row(f"gap in {signal.replace('_', ' ')}", *(f"{value:.3g}" for value in gaps), "%")
    return shown
