"""Linear models of the nonlinear plant at an operating point, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from .arrays import evaluate_tape
from .plain import evaluator
from .plant import Plant
from .tangent import Tangent
from .tape import Ref, Tape, build_tape
from .wiring import Equations

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class OperatingPoint:
    """Operating point: states and inputs by name (SI units), and sliding directions."""

    states: Mapping[str, float]
    inputs: Mapping[str, float]
    directions: Mapping[str, float]


@cache
def _jacobian(equations: Equations) -> tuple[Tape, dict[tuple[int, int], Ref]]:
    """A tape with the Jacobian of the rates by states and inputs, and (row, column) -> its non-zero entries."""
    tape = build_tape(equations)
    seeds = [*(state.name for state in equations.states), *equations.inputs]
    tangent = Tangent(tape, seeds)
    entries = {}
    for row, rate in enumerate(equations.rates):
        for seed, ref in tangent.of(tape.refs[rate]).items():
            entries[row, seeds.index(seed)] = ref
    return tape, entries


def jacobian(
    plant: Plant, point: OperatingPoint, parameters: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Exact derivatives of the rates by states (n, n) and by inputs (n, 2) at a point, for its sliding directions.

    parameters: (n_parameters,) values other than the plant's own, in the order of `plant.vector`.
    """
    tape, entries = _jacobian(plant.structure.equations)
    names = plant.structure.equations.parameter_names
    values = dict(zip(names, plant.vector if parameters is None else parameters, strict=True))
    values |= {**point.states, **point.inputs, **point.directions}
    n = len(plant.structure.equations.states)
    full = np.zeros((n, n + 2))
    for place, value in zip(entries, evaluate_tape(tape, list(entries.values()), values), strict=True):
        full[place] = value
    return full[:, :n], full[:, n:]


def operating_point(
    plant: Plant, *, position: float = 0.0, pressure_level: float | None = None, velocity: float = 0.05
) -> OperatingPoint:
    """The steady motion at `velocity` through `position` [SI units of the moved part: rod, carriage, arm].

    The other states and the drive are the solution for zero acceleration and constant pressures; chambers have the mean
    pressure `pressure_level` [Pa]. Where the motion is prescribed, the drive is zero.

    Raises InputError if the plant sticks at this speed, or if no such motion exists.
    """
    from scipy.optimize import root

    if not np.isfinite([position, velocity, 0.0 if pressure_level is None else pressure_level]).all():
        raise InputError("position, velocity and pressure level of an operating point must be finite numbers")
    structure, system = plant.structure, plant.structure.system
    equations, moved = structure.equations, system.all_contacts[-1]
    if velocity == 0.0 and any(structure.law(contact).sticks for contact in system.contacts):
        raise InputError(
            f"velocity = 0: the {plant.model} model of {plant.name} sticks at rest and has no linear model there; "
            "give a sliding velocity such as 0.05 m/s"
        )
    own = {state.name: state.scale for state in system.states}
    level = plant["P_0"] if pressure_level is None and system.pressures else pressure_level or 0.0
    given = {moved.velocity: velocity, moved.position: position}
    pressures, drive = system.pressures, system.inputs[0]
    free = [name for name in own if name not in given and name not in pressures[1:]]
    positions = {contact.position for contact in system.all_contacts}
    balanced = [name for name in own if name not in positions and name not in pressures[1:]]
    driven = [drive] if len(balanced) > len(free) else []
    directions = dict.fromkeys(equations.directions, float(np.sign(velocity)))
    signals = evaluator(equations, plant.values)
    resting = {name: value for name, value in given.items() if name in own or name in system.inputs}
    others = {name: 0.0 for name in system.inputs if name not in (*resting, *driven)}
    bristles = {c.bristle.name: c for c in system.contacts if structure.law(c).state_rate is not None}
    of_effects = {s.name: s.scale for s in equations.states if s.name not in own and s.name not in bristles}
    others |= dict.fromkeys(of_effects, 0.0)

    def values_of(unknown: np.ndarray) -> dict[str, float]:
        """States and inputs; the unknown of the chambers is half their pressure difference."""
        scales = [*(own[name] for name in free), *(1.0 for _ in driven)]
        values = {**resting, **others, **dict(zip([*free, *driven], unknown * scales, strict=True))}
        if pressures:
            half = values[pressures[0]]
            values |= {pressures[0]: level + half, pressures[1]: level - half}
        for name, contact in bristles.items():
            law = structure.law(contact)
            parameters = {symbol: plant[contact.symbol(symbol)] for symbol in law.symbols}
            values[name] = law.steady_state(values[contact.velocity], parameters)
        return values

    def imbalance(unknown: np.ndarray) -> list[float]:
        found = signals(**values_of(unknown), **directions)
        # Relative to a change of each state by its scale within 10 ms (engineering judgement).
        return [found[f"{name}_dot"] / (100.0 * own[name]) for name in balanced]

    # States of effects: those that move find their steady value, those of neutral effects stay at zero.
    still = values_of(np.zeros(len(free) + len(driven)))
    rates = signals(**still, **directions)
    for name, scale in of_effects.items():
        if signals(**{**still, name: scale}, **directions)[f"{name}_dot"] != rates[f"{name}_dot"]:
            own[name] = scale
            free.append(name)
            balanced.append(name)
            del others[name]
    start = np.array([0.0] * len(free) + [float(np.sign(velocity)) for _ in driven])
    solution = root(imbalance, start, tol=1e-13)
    if np.max(np.abs(solution.fun)) > 1e-6:
        raise InputError(
            f"no steady motion at {velocity:g} {_velocity_unit(plant, moved.velocity)} through {moved.position} = "
            f"{position:g}{f' at {level:g} Pa' if pressures else ''}: a valve, an end stop or the limit of the drive "
            "acts there; choose another operating point"
        )
    found = {name: float(value) for name, value in values_of(solution.x).items()}
    names = [state.name for state in equations.states]
    return OperatingPoint(
        {name: found.get(name, 0.0) for name in names}, {name: found[name] for name in system.inputs}, directions
    )


def _velocity_unit(plant: Plant, velocity: str) -> str:
    """Unit of the moved part's velocity."""
    units = {state.name: state.unit for state in plant.structure.system.states}
    return units.get(velocity, "m/s")


def linearise(
    plant: Plant, *, position: float = 0.0, pressure_level: float | None = None, velocity: float = 0.05
) -> control.StateSpace:
    """Linear model about a steady motion (see `operating_point`): all states as outputs, the system's inputs.

    Of the EHSA with viscous friction and constant volumes it equals (6) at any point.
    """
    import control

    point = operating_point(plant, position=position, pressure_level=pressure_level, velocity=velocity)
    a, b = jacobian(plant, point)
    names = [state.name for state in plant.structure.equations.states]
    return control.ss(
        a,
        b,
        np.eye(len(names)),
        0,
        states=names,
        inputs=list(plant.structure.equations.inputs),
        outputs=names,
        name=f"{plant.name} linearised",
    )
