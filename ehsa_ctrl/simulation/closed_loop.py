"""Simulate a sampled controller with the plant: compiled controllers run inside the engine, others step by step."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.controller_interface import MEASURED, REFERENCE, REFERENCE_FORCE, Controller
from ..core.errors import InputError, SimulationError
from ..core.result import Result
from ..plant.plant import Plant
from .engine import DONE, NO_CURRENT, UNFINISHED, checked_start, initial_carry, initial_modes, why_stopped
from .faults import Faults
from .plant_code import plant_code
from .sensors import Sensors
from .trajectory import Trajectory

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class ClosedLoop(Result):
    """A closed-loop run.

    Attributes
    ----------
    trajectory: true signals, with the current that acted.
    reference: (N, 3) position, velocity, acceleration [m, m/s, m/s2].
    measured: (N, 5) readings that the controller got, in the order of core.controller_interface.MEASURED.
    asked: (N,) current that the controller commanded at each sample [A].
    traces: name -> (N,) recorded entry of the controller's memory.
    force_reference: (N,) target of the load's force [N]; None for a run without one.
    """

    trajectory: Trajectory
    reference: np.ndarray
    measured: np.ndarray
    asked: np.ndarray
    traces: Mapping[str, np.ndarray] = field(default_factory=dict)
    force_reference: np.ndarray | None = None

    def __getitem__(self, name: str) -> np.ndarray:
        """A signal by name (N,): those of the trajectory, error, asked, reference_NAME, measured_NAME, or a trace;
        with a force target, reference_force too.

        Raises InputError for a name that is not there.
        """
        for prefix, names, table in (
            ("reference_", REFERENCE, self.reference),
            ("measured_", MEASURED, self.measured),
        ):
            if name.removeprefix(prefix) in names and name.startswith(prefix):
                return np.asarray(table[:, names.index(name.removeprefix(prefix))])
        own = {"error": self.error, "asked": self.asked, **self.traces}
        if self.force_reference is not None:
            own["reference_force"] = self.force_reference
        return own[name] if name in own else self.trajectory[name]

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def error(self) -> np.ndarray:
        """True position error r - x (N,) [m]."""
        return self.reference[:, 0] - self.trajectory["x"]

    def to_pandas(self) -> pandas.DataFrame:
        """One row a sample: the trajectory's columns, reference, measured values, current asked for and traces."""
        table = self.trajectory.to_pandas()
        for k, name in enumerate(REFERENCE):
            table[f"reference_{name}"] = self.reference[:, k]
        if self.force_reference is not None:
            table["reference_force"] = self.force_reference
        for k, name in enumerate(MEASURED):
            table[f"measured_{name}"] = self.measured[:, k]
        traces = {f"controller_{name}": values for name, values in self.traces.items()}
        return table.assign(asked=self.asked, **traces)

    def plot(self) -> Figure:
        """The trajectory's figure."""
        return self.trajectory.plot()

    def __str__(self) -> str:
        return f"{self.trajectory}\n  error {1e3 * abs(self.error[-1]):.4g} mm at the end"

    def first(self, samples: int) -> ClosedLoop:
        """The first samples of this run, for a comparison with a run that stopped early."""
        run = self.trajectory
        names = ("time", "current", "outer_force", "states", "modes", "cell_force")
        cut = replace(run, **{name: getattr(run, name)[:samples] for name in names})
        traces = {name: values[:samples] for name, values in self.traces.items()}
        force = None if self.force_reference is None else self.force_reference[:samples]
        return ClosedLoop(cut, self.reference[:samples], self.measured[:samples], self.asked[:samples], traces, force)


def run_closed_loop(
    plant: Plant,
    controller: Controller,
    reference: np.ndarray,
    *,
    force: np.ndarray | None = None,
    sensors: Sensors | None = None,
    lag: int = 0,
    faults: Faults | None = None,
    start: np.ndarray | None = None,
    tolerance: float = 1e-6,
    compiled: bool | None = None,
    raise_on_failure: bool = True,
) -> ClosedLoop:
    """Simulate a plant under a sampled controller.

    Parameters
    ----------
    reference: (N, 3) position, velocity and acceleration [m, m/s, m/s2], one row per sample of the controller; (N, 4)
        with the target of the load's force [N]; or positions alone (N,), with zero velocity and acceleration.
    force: (N,) external force [N], positive when it resists extension; zero by default.
    sensors: ideal ones by default.
    lag: samples between a measurement and the current computed from it.
    faults: of sensors and drive; none by default.
    start: state (n,) at the first sample; rest by default.
    tolerance: as for `simulate`.
    compiled: False uses the controller's step in Python; by default the compiled one if there is one.
    raise_on_failure: False returns the samples up to the failure, with the reason in `stopped` of the trajectory.

    Raises
    ------
    InputError: wrong shapes, values that are not finite; memory or settings of the controller that are no array (k,)
        of floats; a compiled step that can't be used.
    SimulationError: the run stopped early; the message has the time and the cause.
    """
    reference = np.array(reference, dtype=float, order="C")
    if reference.ndim == 1:
        reference = np.column_stack([reference, np.zeros((reference.size, 2))])
    if reference.ndim != 2 or reference.shape[0] < 2 or reference.shape[1] not in (3, 4):
        raise InputError(
            f"reference has shape {reference.shape}; expected (samples, 3), or (samples, 4) with a force target, "
            "at least two samples"
        )
    target = reference[:, REFERENCE_FORCE].copy() if reference.shape[1] == 4 else None
    # A compiled law that follows a force reads four numbers a row.
    reference = np.ascontiguousarray(
        np.column_stack([reference[:, :3], np.zeros(len(reference)) if target is None else target])
    )
    samples = reference.shape[0]
    outer = np.zeros(samples) if force is None else np.array(force, dtype=float)
    if outer.shape != (samples,):
        raise InputError(f"force has shape {outer.shape}; expected ({samples},)")
    if not (np.isfinite(reference).all() and np.isfinite(outer).all()):
        raise InputError("reference and force must be finite numbers at every sample")
    if not 0 <= lag < samples or lag != int(lag):
        raise InputError(f"lag = {lag}; expected a whole number of samples, 0 or more and fewer than the run has")
    sensors = sensors or Sensors.of(plant, ideal=True)
    dt = controller.sample_time
    scale, noise, resolution, delay, weights = sensors.tables(samples, dt)
    state = checked_start(plant, start)
    n = state.size
    states = np.full((samples, n), np.nan)
    modes = np.zeros((samples, len(plant.structure.system.contacts)), dtype=np.int8)
    measured = np.full((samples, len(MEASURED)), np.nan)
    asked = np.full(samples, np.nan)
    extremes = np.stack([state, state])
    mode = initial_modes(plant, state)
    carry = initial_carry(plant, 1, dt)[0]
    true, filtered = np.empty((2, samples, len(MEASURED)))
    fault, ceiling = (faults or Faults()).tables(dt * np.arange(samples))
    memory, settings = (_own_numbers(controller, of) for of in ("initial_memory", "settings"))
    traced = np.array(list(controller.traces.values()), dtype=np.int64)
    traces = np.full((samples, traced.size), np.nan)
    from .closed_loop_kernel import closed_loop

    code = plant_code(plant.structure.equations)
    step = controller.compiled if compiled is None or compiled else None
    parameters, law = plant.vector, 0 if step is None else _address_of_step(controller, step)

    def run(stop: int) -> int:
        """Advance the engine to sample stop - 1. It returns now and then, so that Python can handle an interrupt."""
        status = UNFINISHED
        while status == UNFINISHED:
            status = closed_loop(
                *code.arguments, stop, parameters, state, mode, carry, law, settings, memory, reference, outer, scale,
                noise, resolution, delay, weights, int(lag), dt, tolerance, states, modes, true, filtered, measured,
                asked, extremes, fault, ceiling, traced, traces,
            )  # fmt: skip
        return status

    if step is not None:
        status = run(samples)
    elif compiled:
        raise InputError(f"controller {controller.name} has no compiled step; leave out compiled=True")
    else:
        for k in range(samples):
            status = run(k + 1)
            if status == DONE:
                asked[k] = controller.step(reference[k], measured[k], memory)
                traces[k] = memory[traced]
                status = DONE if np.isfinite(asked[k]) else NO_CURRENT
            if status != DONE:
                break
    there = slice(int(np.count_nonzero(np.isfinite(states[:, 0]))))
    last = there.stop - 1
    inputs = np.array([np.nan_to_num(asked[max(last - lag, 0)]), outer[last]])
    who = f"{plant.name} with {controller.name}"
    stopped = why_stopped(plant, status, last * dt, state, inputs, mode, who)
    if stopped and (raise_on_failure or there.stop < 2):
        raise SimulationError(stopped)
    late = np.concatenate([np.zeros(lag), asked[: samples - lag]]) if lag else asked
    acting = np.clip(late, -ceiling, ceiling)
    trajectory = Trajectory(
        plant=plant,
        time=dt * np.arange(there.stop),
        current=acting[there],
        outer_force=outer[there],
        states=states[there],
        modes=modes[there],
        cell_force=true[there, MEASURED.index("force")],
        extremes=extremes,
        hold="zero_order",
        tolerance=tolerance,
        stopped=stopped,
    )
    by_name = {name: traces[there, i] for i, name in enumerate(controller.traces)}
    rows = reference[there, : len(REFERENCE)]
    return ClosedLoop(
        trajectory, rows, measured[there], asked[there], by_name, None if target is None else target[there]
    )


def _address_of_step(controller: Controller, step: Callable[..., float]) -> int:
    """Address of a controller's compiled step. Raises InputError, with the cause, if it can't be used."""
    from numba.core.errors import NumbaError

    from ..core.pointers import address_of
    from .closed_loop_kernel import CONTROLLER

    try:
        return address_of(step, CONTROLLER)
    except (TypeError, NumbaError) as error:
        # numba's text has terminal colours, and begins with the pass that failed.
        lines = re.sub(r"\x1b\[\d*m", "", str(error)).splitlines()
        why = next((line for line in lines if line and not line.startswith("Failed in")), type(error).__name__)
        raise InputError(
            f"controller {controller.name}: compiled can't be used ({why}); expected a function of numba.njit that "
            "takes four arrays (k,) of float64 and returns a float"
        ) from error


def _own_numbers(controller: Controller, of: str) -> np.ndarray:
    """What a method of a controller returns, as the engine needs it; the step changes its memory in place."""
    found = getattr(controller, of)()
    if isinstance(found, np.ndarray) and found.dtype == float and found.ndim == 1 and found.flags.c_contiguous:
        return found
    what = f"an array {found.shape} of {found.dtype}" if isinstance(found, np.ndarray) else type(found).__name__
    raise InputError(f"controller {controller.name}: {of}() returns {what}; expected an array (k,) of float64")
