"""Derivatives of a run by parameters and initial states: exact through sticking, sliding and the instants between.

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
from .compiled import engine
from .engine import DONE, STATUS, Hold, checked_input, initial_carry, initial_modes


@dataclass(frozen=True)
class Sensitivities:
    """A run and its derivatives.

    names: (k,) parameters, then "initial " + state for initial states. states: (N, n). values: (N, n, k) derivative
    of each state by each of names, SI units.
    """

    names: tuple[str, ...]
    states: np.ndarray
    values: np.ndarray


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
    parameters: names to differentiate by; P_0 and x_0 act through the initial state if `start` is not given.
    initial_states: names of states whose initial value to differentiate by.
    Other arguments as for `simulate`.

    Raises
    ------
    InputError: an unknown name; an input of the wrong shape or not finite.
    SimulationError: the run could not be finished.
    """
    equations = plant.structure.equations
    names = list(equations.parameter_names)
    for parameter in parameters:
        if parameter not in names:
            raise InputError(f"{plant.name} has no parameter {parameter!r}; {choices(parameter, names)}")
    states = [state.name for state in equations.states]
    for state in initial_states:
        if state not in states:
            raise InputError(f"{plant.name} has no state {state!r}; {choices(state, states)}")
    current = checked_input(current, "current")
    outer = np.zeros(current.size) if force is None else checked_input(force, "force", current.size)
    dt = plant.sample_time if sample_time is None else sample_time
    width = len(parameters) + len(initial_states)
    columns = np.full(len(names), width, dtype=np.int64)
    S = np.zeros((len(states), width + 1))
    for column, parameter in enumerate(parameters):
        columns[names.index(parameter)] = column
        if start is None and parameter == "P_0":
            S[[states.index("P_1"), states.index("P_2")], column] = 1.0
        if start is None and parameter == "x_0":
            S[states.index("x"), column] = 1.0
    for column, state in enumerate(initial_states, len(parameters)):
        S[states.index(state), column] = 1.0
    y = np.array(plant.rest if start is None else start, dtype=float)
    out = np.full((current.size, len(states)), np.nan)
    values = np.empty((current.size, len(states), width))
    status = engine(plant.structure, "sensitivity").sensitivity(
        plant.vector,
        y,
        initial_modes(plant, y),
        initial_carry(plant, 1, dt)[0],
        current,
        outer,
        hold == "first_order",
        dt,
        tolerance,
        columns,
        S,
        out,
        values,
        np.stack([y, y]),
    )
    if status != DONE:
        at = int(np.count_nonzero(~np.isnan(out[:, 0]))) - 1
        raise SimulationError(f"{plant.name}: stopped at {at * dt:.4g} s: {STATUS[int(status)]}")
    return Sensitivities((*parameters, *(f"initial {state}" for state in initial_states)), out, values)
