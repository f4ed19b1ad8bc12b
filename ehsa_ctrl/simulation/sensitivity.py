"""Derivatives of a run with respect to parameters and initial states, exact through stops and breakaways.

Forward sensitivities are integrated along the run, with a jump at each stop. The instants of stops and breakaways
shift with the parameters. Finite differences jump whenever such an instant crosses a sample; these derivatives do not.

Source of the jump: I. A. Hiskens, M. A. Pai, "Trajectory sensitivity analysis of hybrid systems", IEEE Trans.
Circuits and Systems I 47(2), 2000 (here for events at which only the rates are discontinuous).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError, SimulationError, choices
from ..plant.plant import Plant
from .engine import DONE, UNFINISHED, Hold, checked_inputs, checked_start, initial_carry, initial_modes, why_stopped
from .plant_code import plant_code


@dataclass(frozen=True)
class Sensitivities:
    """A run and its derivatives.

    names: (k,) parameters and inputs, then "initial STATE" for initial states. states: (N, n). values: (N, n, k)
    derivative of each state with respect to each name, SI units.
    """

    names: tuple[str, ...]
    states: np.ndarray
    values: np.ndarray

    def __repr__(self) -> str:
        samples, states, _ = self.values.shape
        return f"Sensitivities of {states} states at {samples} samples by {', '.join(self.names)}"


@dataclass(frozen=True)
class Transitions:
    """A run, linearised over each sample: x[k + 1] = by_state[k] x[k] + by_input[k] u[k] + by_parameter[k] p.

    x, u and p are deviations from the run. states (N, n), by_state (N - 1, n, n), by_input (N - 1, n) for the first
    input, by_parameter (N - 1, n, k) in the order of `names`.
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
    """Simulate the plant and differentiate the run.

    Parameters
    ----------
    parameters: names of parameters, or of inputs for a constant added to that input. P_0 and x_0 act through the
        initial state unless `start` is given.
    initial_states: names of states, for derivatives with respect to their initial values.
    Other arguments as for `simulate`.

    Raises
    ------
    InputError: an unknown name; an input of the wrong shape or not finite.
    SimulationError: the run stopped early.
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
    """Simulate the plant and linearise the run over each sample, e.g. for a Kalman filter along the run.

    Arguments and errors as for `sensitivities`, but parameters don't act through the initial state.
    """
    n = len(plant.structure.equations.states)
    first = plant.structure.system.inputs[0]
    S = np.zeros((n, n + 1 + len(parameters) + 1))
    S[:, :n] = np.eye(n)
    # The first n columns are those of the states; the named ones follow.
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
    """States (N, n) and derivatives (N, n, k) of a run with initial derivatives S (n, k + 1)."""
    equations = plant.structure.equations
    known = [*equations.parameter_names, *equations.inputs]
    columns = np.full(len(known), S.shape[1] - 1, dtype=np.int64)
    for column, name in enumerate(names, first_column):
        if name not in known:
            raise InputError(f"{plant.name} has no parameter {name!r}; {choices(name, known)}")
        columns[known.index(name)] = column
    current, outer = checked_inputs(current, force)
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
