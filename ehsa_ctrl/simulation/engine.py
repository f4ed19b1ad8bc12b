"""Run a plant: one run, or many with varied parameters, on the compiled engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.errors import InputError, SimulationError
from ..plant.plant import Plant
from .plant_code import PlantCode, plant_code
from .response import drives_of, is_response
from .stiffness import stiffest
from .threads import free_threads, in_threads, is_ended
from .trajectory import Trajectory

if TYPE_CHECKING:
    import control

Hold = Literal["zero_order", "first_order"]

DONE, NO_CURRENT, UNFINISHED = 0, 3, 5
#: Sentence for each status that the compiled loops return.
STATUS = {
    0: "",
    1: "the step length became too small: a state or a parameter is outside the range where the equations hold",
    2: "a contact changed between sticking and sliding more than 1000 times within one sample",
    3: "the controller returned a current that is not a finite number",
    4: "one sample takes more than 20000 steps, so the run would not end in a reasonable time",
}


#: See `open_loop_kernel.open_loop`.
NO_IMPULSES = np.empty((0, 0, 0))
#: Largest magnitude of an input, SI units, as in `core.definition`.
LARGEST = 1e30


def initial_modes(plant: Plant, states: np.ndarray) -> np.ndarray:
    """Sliding directions (..., contacts) of states (..., n): 0 if the speed is exactly zero."""
    equations = plant.structure.equations
    columns = [equations.index(contact.velocity) for contact in plant.structure.system.contacts]
    return np.ascontiguousarray(np.sign(states[..., columns]))


def initial_carry(plant: Plant, runs: int, sample_time: float) -> np.ndarray:
    """Initial working memory (runs, ...) of the engine: `memory` of `integrator.advance`, and the sample."""
    equations = plant.structure.equations
    carry = np.zeros((runs, 4 + len(equations.states) + len(plant.structure.system.contacts)))
    carry[:, 0] = sample_time
    carry[:, 1] = np.nan
    return carry


def run_open_loop(
    code: PlantCode,
    parameters: np.ndarray,
    states: np.ndarray,
    modes: np.ndarray,
    carry: np.ndarray,
    *inputs_and_outputs: Any,
    status: np.ndarray,
    impulses: np.ndarray = NO_IMPULSES,
) -> None:
    """Simulate all samples of every run that has not failed; arguments as in `open_loop_kernel.open_loop`.

    The engine returns after some tenths of a second at most, so that Python can handle an interrupt.
    """
    from .open_loop_kernel import open_loop

    carry[:, -1] = 0.0
    status[status == DONE] = UNFINISHED
    while (status == UNFINISHED).any() and not is_ended():
        open_loop(*code.arguments, parameters, states, modes, carry, *inputs_and_outputs, impulses, status)


def checked_input(values: np.ndarray | Sequence[float], name: str, length: int | None = None) -> np.ndarray:
    """The values as a vector of finite samples. Raises InputError, with the input's name, for anything else."""
    # A copy, because the engine is compiled for writable arrays, and pandas may give a read-only one.
    array = np.array(values, dtype=float, order="C")
    if array.ndim != 1 or array.size < 2 or (length is not None and array.size != length):
        wanted = "a vector of at least two samples" if length is None else f"a vector of {length} samples"
        raise InputError(f"{name} has shape {array.shape}; expected {wanted}")
    bad = np.flatnonzero(~(np.abs(array) <= LARGEST))
    if bad.size:
        raise InputError(f"{name} is {array[bad[0]]} at sample {bad[0]}; every sample must be a finite number")
    return array


def checked_inputs(
    current: np.ndarray | Sequence[float], force: np.ndarray | Sequence[float] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Current (N,) and outer force (N,), by default zero. Raises InputError as `checked_input` does."""
    checked = checked_input(current, "current")
    return checked, np.zeros(checked.size) if force is None else checked_input(force, "force", checked.size)


def checked_start(plant: Plant, start: np.ndarray | Sequence[float] | None) -> np.ndarray:
    """A copy of the initial state (n,), by default rest. Raises InputError for another shape or infinite numbers."""
    first = np.array(plant.rest if start is None else start, dtype=float)
    if first.shape != plant.rest.shape:
        raise InputError(f"start has shape {first.shape}; the plant has {plant.rest.size} states")
    if not np.isfinite(first).all():
        raise InputError(f"start is {first.tolist()}; expected finite numbers")
    return first


def simulate(
    plant: Plant,
    current: np.ndarray | Sequence[float] | control.TimeResponseData,
    *,
    force: np.ndarray | Sequence[float] | None = None,
    hold: Hold = "zero_order",
    start: np.ndarray | Sequence[float] | None = None,
    sample_time: float | None = None,
    tolerance: float = 1e-6,
    raise_on_failure: bool = True,
) -> Trajectory:
    """Simulate the plant with a given current.

    For a system other than the EHSA, `current` is its first input and `force` its second one.

    Parameters
    ----------
    plant: see `load_plant`.
    current: (N,) A, one value per sample, or a time response of python-control with an input or output of that name.
        Such a response also gives the sample time and, if it has F_D, the force.
    force: (N,) external force [N], positive when it resists extension; zero by default.
    hold: current and force between samples: "zero_order" holds them, "first_order" interpolates linearly, as
        python-control does.
    start: state (n,) at the first sample; rest by default.
    sample_time: s; by default that of the plant.
    tolerance: error per step in units of the states' scales. Errors of whole runs measured at 1e-6: some 1e-5 of each
        signal's range on the benchmark's cases, and less than 0.5 um of rod position on 500 slow stops, except for
        those that depend on rounding in double precision (docs/theory/engine.md).
    raise_on_failure: False returns the samples up to the failure, with the reason in `stopped`.

    Returns
    -------
    Trajectory: N samples; the first one is the initial state.

    Raises
    ------
    InputError: an input that is not a vector, too short or not finite.
    SimulationError: the run stopped early; the message has the time and the cause.
    """
    if is_response(current):
        if sample_time is not None:
            raise InputError("sample_time is given twice; leave it out, because the time response has one")
        current, outside, sample_time = drives_of(plant, current)
        force = outside if force is None else force
    current, outer = checked_inputs(current, force)
    dt = plant.sample_time if sample_time is None else sample_time
    first = checked_start(plant, start)
    batch = _run(plant, plant.vector[None, :], first[None, :], current, outer, hold, dt, tolerance)
    there = slice(int(np.count_nonzero(np.isfinite(batch.states[0, :, 0]))))
    last = there.stop - 1
    inputs = np.array([current[last], outer[last]])
    stopped = why_stopped(plant, int(batch.status[0]), last * dt, batch.ends[0], inputs, batch.directions[0])
    if stopped and (raise_on_failure or there.stop < 2):
        raise SimulationError(stopped)
    return Trajectory(
        plant=plant,
        time=dt * np.arange(there.stop),
        current=current[there],
        outer_force=outer[there],
        states=batch.states[0, there],
        modes=batch.modes[0, there],
        cell_force=batch.cell_force[0, there],
        extremes=batch.extremes[0],
        hold=hold,
        tolerance=tolerance,
        stopped=stopped,
    )


def why_stopped(
    plant: Plant, status: int, time: float, states: np.ndarray, inputs: np.ndarray, modes: np.ndarray, who: str = ""
) -> str:
    """Error message for a status, with the stiffest terms at the point where the run stopped; empty for DONE.

    who: subject of the sentence; by default the plant's name.
    """
    if status == DONE:
        return ""
    stiff = stiffest(plant, states, inputs, modes) if status != NO_CURRENT else ""
    return f"{who or plant.name}: stopped at {time:.4g} s: {STATUS[status]}" + (f"; {stiff}" if stiff else "")


@dataclass(frozen=True)
class Batch:
    """Many runs with the same input.

    states (runs, N, n), modes (runs, N, contacts), cell_force (runs, N), extremes (runs, 2, n): as in Trajectory; nan
    after a failure. status (runs,): 0 for a finished run, otherwise a key of STATUS. ends (runs, n), directions
    (runs, contacts): states and sliding directions at the end of each run, within a sample if it failed.
    """

    states: np.ndarray
    modes: np.ndarray
    cell_force: np.ndarray
    extremes: np.ndarray
    status: np.ndarray
    ends: np.ndarray
    directions: np.ndarray


def simulate_batch(
    plant: Plant,
    parameters: np.ndarray,
    current: np.ndarray | Sequence[float],
    *,
    force: np.ndarray | Sequence[float] | None = None,
    hold: Hold = "zero_order",
    start: np.ndarray | None = None,
    sample_time: float | None = None,
    tolerance: float = 1e-4,
    jobs: int | None = None,
) -> Batch:
    """Simulate variations of a plant with the same input, on all cores.

    Parameters
    ----------
    parameters: (runs, n_parameters), each row in the order of `plant.vector`.
    start: (runs, n) states at the first sample; by default rest with the P_0 and x_0 of each row.
    jobs: number of threads; all cores by default.
    Other arguments as for `simulate`.

    A run that fails does not stop the others; its `status` tells.

    Raises
    ------
    InputError: arrays of the wrong shape, or an input that is not finite.
    """
    current, outer = checked_inputs(current, force)
    parameters = np.array(parameters, dtype=float, order="C")
    names = plant.structure.equations.parameter_names
    if parameters.ndim != 2 or parameters.shape[1] != len(names):
        raise InputError(f"parameters has shape {parameters.shape}; expected (runs, {len(names)})")
    runs = parameters.shape[0]
    if start is None:
        states = np.tile(plant.rest, (runs, 1))
        for state, parameter in plant.structure.system.start.items():
            states[:, plant.structure.equations.index(state)] = parameters[:, names.index(parameter)]
    else:
        states = np.array(start, dtype=float)
        if states.shape != (runs, plant.rest.size):
            raise InputError(f"start has shape {states.shape}; expected ({runs}, {plant.rest.size})")
    dt = plant.sample_time if sample_time is None else sample_time
    return _run(plant, parameters, states, current, outer, hold, dt, tolerance, jobs)


def _run(
    plant: Plant,
    parameters: np.ndarray,
    start: np.ndarray,
    current: np.ndarray,
    force: np.ndarray,
    hold: Hold,
    dt: float,
    tolerance: float,
    jobs: int | None = 1,
) -> Batch:
    if hold not in ("zero_order", "first_order"):
        raise InputError(f"hold = {hold!r}; expected 'zero_order' or 'first_order'")
    if not 1e-13 <= tolerance <= 1e-1:
        raise InputError(f"tolerance = {tolerance:g}; expected 1e-13 to 0.1")
    if not 0.0 < dt < 1.0:
        raise InputError(f"sample_time = {dt:g} s; expected more than 0 and less than 1 s")
    code = plant_code(plant.structure.equations)
    runs, n = start.shape
    samples = current.size
    states = np.array(start)
    modes = initial_modes(plant, states)
    carry = initial_carry(plant, runs, dt)
    out = Batch(
        states=np.full((runs, samples, n), np.nan),
        modes=np.zeros((runs, samples, modes.shape[1]), dtype=np.int8),
        cell_force=np.full((runs, samples), np.nan),
        extremes=np.stack([start, start], axis=1),
        status=np.zeros(runs, dtype=np.int64),
        ends=states,
        directions=modes,
    )

    def work(part: slice) -> None:
        run_open_loop(
            code, parameters[part], states[part], modes[part], carry[part], current, force, hold == "first_order", dt,
            tolerance, out.states[part], out.modes[part], out.cell_force[part], out.extremes[part],
            status=out.status[part],
        )  # fmt: skip

    jobs = min(free_threads(jobs), runs)
    if jobs == 1:
        work(slice(None))
    else:
        # More parts than threads, so that one slow part does not leave the other threads idle at the end.
        edges = np.linspace(0, runs, min(4 * jobs, runs) + 1).astype(int)
        list(in_threads(work, [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)], jobs))
    return out
