"""Linear models of the nonlinear plant at an operating point, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from .arrays import evaluate_tape
from .linear import INPUTS
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
    """The steady motion at rod speed `velocity` [m/s] through `position` [m], at (P_1 + P_2) / 2 = pressure_level [Pa].

    Speed, pressure difference and current are the solution for zero acceleration of shaft and rod and constant
    pressure in chamber 1.

    Raises InputError if the plant sticks at this speed, or if no such motion exists.
    """
    from scipy.optimize import root

    if not np.isfinite([position, velocity, 0.0 if pressure_level is None else pressure_level]).all():
        raise InputError("position, velocity and pressure level of an operating point must be finite numbers")
    structure = plant.structure
    equations = structure.equations
    if structure.system_name != "ehsa":
        raise InputError(f"{plant.name} is a {structure.system_name!r} system; linear models exist only for 'ehsa'")
    if velocity == 0.0 and any(structure.law(contact).sticks for contact in structure.system.contacts):
        raise InputError(
            f"velocity = 0: the {plant.model} model of {plant.name} sticks at rest and has no linear model there; "
            "give a sliding velocity such as 0.05 m/s"
        )
    level = plant["P_0"] if pressure_level is None else pressure_level
    direction = float(np.sign(velocity))
    directions = dict.fromkeys(equations.directions, direction)
    signals = evaluator(equations, plant.values)
    bristles = {}
    for contact in structure.system.contacts:
        law = structure.law(contact)
        if law.state_rate is not None:
            bristles[contact.bristle.name] = contact

    def states(unknown: np.ndarray) -> dict[str, float]:
        omega, half, _ = unknown * (100.0, 1e5, 1.0)
        values = {"omega": omega, "P_1": level + half, "P_2": level - half, "v": velocity, "x": position}
        for name, contact in bristles.items():
            law = structure.law(contact)
            parameters = {symbol: plant[contact.symbol(symbol)] for symbol in law.symbols}
            values[name] = law.steady_state(values[contact.velocity], parameters)
        return values

    def imbalance(unknown: np.ndarray) -> list[float]:
        found = signals(**states(unknown), current=unknown[2], F_D=0.0, **directions)
        return [found["omega_dot"] / 1e4, found["P_1_dot"] / 1e8, found["v_dot"] / 1e2]

    start = np.array([velocity * plant["A"] / plant["D"] / 100.0, 0.0, direction])
    solution = root(imbalance, start, tol=1e-13)
    if np.max(np.abs(solution.fun)) > 1e-6:
        raise InputError(
            f"no steady motion at {velocity:g} m/s through x = {position:g} m at {level:g} Pa: "
            "a valve or end stop acts there; choose another operating point"
        )
    inputs = {"current": float(solution.x[2]), "F_D": 0.0}
    return OperatingPoint({k: float(v) for k, v in states(solution.x).items()}, inputs, directions)


def linearise(
    plant: Plant, *, position: float = 0.0, pressure_level: float | None = None, velocity: float = 0.05
) -> control.StateSpace:
    """Linear model about a steady motion (see `operating_point`), all states as outputs, inputs current and F_D.

    With viscous friction and constant volumes it equals (6) at any point.
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
        inputs=list(INPUTS),
        outputs=names,
        name=f"{plant.name} linearised",
    )


def reduce_to_difference(system: control.StateSpace, plant: Plant) -> control.StateSpace:
    """From states omega, P_1, P_2, v, x to omega, dP, v, x, as (7) does from (6): without the mode of P_1 + P_2.

    Exact where the equations depend only on the pressure difference; with effects on one chamber it is the model at
    constant pressure level.
    """
    import control

    names = list(system.state_labels)
    first, second = names.index("P_1"), names.index("P_2")
    kept = [name for name in names if name != "P_2"]
    to_difference = np.delete(np.eye(len(names)), second, axis=0)
    to_difference[first, second] = -1.0
    from_difference = np.delete(np.eye(len(names)), second, axis=1)
    from_difference[first, first], from_difference[second, first] = 0.5, -0.5
    labels = ["dP" if name == "P_1" else name for name in kept]
    return control.ss(
        to_difference @ system.A @ from_difference,
        to_difference @ system.B,
        np.eye(len(kept)),
        0,
        states=labels,
        inputs=list(INPUTS),
        outputs=labels,
        name=f"{plant.name} ({plant.model}) linearised",
    )
