"""Derivatives of a run by parameters and initial states, exact through stops and breakaways.

Forward sensitivities along the run with the jump that each stop makes. A breakaway and a stop move in time with the
parameters; differences of two runs see that as a jump wherever an instant crosses a sample, these derivatives don't.

Source of the jump: I. A. Hiskens, M. A. Pai, "Trajectory sensitivity analysis of hybrid systems", IEEE Trans.
Circuits and Systems I 47(2), 2000 (here for events at which only the rates are discontinuous).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError, SimulationError, choices
from ..plant.plant import Plant
from .engine import DONE, UNFINISHED, Hold, checked_input, checked_start, initial_carry, initial_modes, why_stopped
from .plant_code import plant_code


@dataclass(frozen=True)
class Sensitivities:
    """A run and its derivatives.

    names: (k,) parameters and inputs, then "initial " + state for initial states. states: (N, n). values: (N, n, k)
    derivative of each state by each of names, SI units.
    """

    names: tuple[str, ...]
    states: np.ndarray
    values: np.ndarray

    def __repr__(self) -> str:
        samples, states, _ = self.values.shape
        return f"Sensitivities of {states} states at {samples} samples by {', '.join(self.names)}"


@dataclass(frozen=True)
class Transitions:
    """A run as a chain of samples: state k + 1 = by_state[k] state k + by_input[k] input k + by_parameter[k] p.

    Deviations from the run; states (N, n), modes as at the run's start, by_state (N-1, n, n), by_input (N-1, n) for
    the first input, by_parameter (N-1, n, k) in the order of `names`.
    """

    names: tuple[str, ...]
    states: np.ndarray
    by_state: np.ndarray
    by_input: np.ndarray
    by_parameter: np.ndarray

    def __repr__(self) -> str:
        samples, states = self.states.shape
        return f"Transitions of {states} states over {samples} samples by {', '.join(self.names)}"


def sensitivities(
    plant: Plant,
    parameters: Sequence[str],
    current: np.ndarray | Sequence[float],
    *,
    initial_states: Sequence[str] = (),
    force: np.ndarray | Sequence[float] | None = None,
    hold: Hold = "zero_order",
    start: np.ndarray | None = None,
    sample_time: float | None = None,
    tolerance: float = 1e-6,
) -> Sensitivities:
    """Run the plant and differentiate the run.

    Parameters
    ----------
    parameters: names to differentiate by: parameters, or inputs (a constant on top of that input); P_0 and x_0 act
        through the initial state if `start` is not given.
    initial_states: names of states whose initial value to differentiate by.
    Other arguments as for `simulate`.

    Raises
    ------
    InputError: an unknown name; an input of the wrong shape or not finite.
    SimulationError: the run could not be finished.
    """
    states = [state.name for state in plant.structure.equations.states]
    for state in initial_states:
        if state not in states:
            raise InputError(f"{plant.name} has no state {state!r}; {choices(state, states)}")
    S = np.zeros((len(states), len(parameters) + len(initial_states) + 1))
    for column, parameter in enumerate(parameters):
        if start is None and parameter == "P_0":
            S[[states.index("P_1"), states.index("P_2")], column] = 1.0
        if start is None and parameter == "x_0":
            S[states.index("x"), column] = 1.0
    for column, state in enumerate(initial_states, len(parameters)):
        S[states.index(state), column] = 1.0
    out, values = _run(plant, parameters, S, False, current, force, hold, start, sample_time, tolerance)
    return Sensitivities((*parameters, *(f"initial {state}" for state in initial_states)), out, values)


def transitions(
    plant: Plant,
    parameters: Sequence[str],
    current: np.ndarray | Sequence[float],
    *,
    force: np.ndarray | Sequence[float] | None = None,
    hold: Hold = "zero_order",
    start: np.ndarray | None = None,
    sample_time: float | None = None,
    tolerance: float = 1e-6,
) -> Transitions:
    """Run the plant and linearise each sample of the run, e.g. for a Kalman filter along the run.

    Arguments and errors as for `sensitivities`; parameters don't act through the initial state here.
    """
    n = len(plant.structure.equations.states)
    first = plant.structure.system.inputs[0]
    S = np.zeros((n, n + 1 + len(parameters) + 1))
    S[:, :n] = np.eye(n)
    # The columns of the states come first, so that the named ones are numbered from n on.
    out, values = _run(plant, [first, *parameters], S, True, current, force, hold, start, sample_time, tolerance, n)
    return Transitions(tuple(parameters), out, values[1:, :, :n], values[1:, :, n], values[1:, :, n + 1 :])


def _run(
    plant: Plant,
    names: Sequence[str],
    S: np.ndarray,
    restart: bool,
    current: np.ndarray | Sequence[float],
    force: np.ndarray | Sequence[float] | None,
    hold: Hold,
    start: np.ndarray | None,
    sample_time: float | None,
    tolerance: float,
    first_column: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """States (N, n) and derivatives (N, n, columns of S but the last) of a run that begins with derivatives S."""
    equations = plant.structure.equations
    known = [*equations.parameter_names, *equations.inputs]
    columns = np.full(len(known), S.shape[1] - 1, dtype=np.int64)
    for column, name in enumerate(names, first_column):
        if name not in known:
            raise InputError(f"{plant.name} has no parameter {name!r}; {choices(name, known)}")
        columns[known.index(name)] = column
    current = checked_input(current, "current")
    outer = np.zeros(current.size) if force is None else checked_input(force, "force", current.size)
    dt = plant.sample_time if sample_time is None else sample_time
    y = checked_start(plant, start)
    out = np.full((current.size, y.size), np.nan)
    values = np.empty((current.size, y.size, S.shape[1] - 1))
    code = plant_code(plant.structure.equations, sensitivities=True)
    from .sensitivity_kernel import sensitivity

    modes, carry = initial_modes(plant, y), initial_carry(plant, 1, dt)[0]
    extremes, status = np.stack([y, y]), UNFINISHED
    while status == UNFINISHED:
        status = sensitivity(
            *code.arguments,
            plant.vector,
            y,
            modes,
            carry,
            current,
            outer,
            hold == "first_order",
            dt,
            tolerance,
            columns,
            restart,
            S,
            out,
            values,
            extremes,
        )
    if status != DONE:
        at = int(np.count_nonzero(~np.isnan(out[:, 0]))) - 1
        raise SimulationError(why_stopped(plant, int(status), at * dt, y, np.array([current[at], outer[at]]), modes))
    return out, values
