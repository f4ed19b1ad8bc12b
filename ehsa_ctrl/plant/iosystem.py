"""The nonlinear plant as `control.NonlinearIOSystem`, for python-control's functions.

python-control integrates a smooth right-hand side, so friction is smoothed here: direction = tanh(speed / width).
A smoothed contact creeps instead of sticking; where sticking matters, use the engine (`simulate`).
"""

from __future__ import annotations

from math import tanh
from typing import TYPE_CHECKING, Any

import numpy as np

from .plain import evaluator
from .plant import Plant

if TYPE_CHECKING:
    import control

#: Speeds over which friction reverses, shaft [rad/s] and rod [m/s]. Engineering judgement: the error of a simulation
#: grows with them, its stiffness with their inverse.
WIDTHS = {"shaft": 0.01, "rod": 1e-5}


def to_iosystem(plant: Plant) -> control.NonlinearIOSystem:
    """The plant for python-control: inputs current and F_D, states and outputs of the equations, SI units.

    The system's `params` are the plant's parameters: `input_output_response(..., params={"K_T": 1.1})`. python-control
    interpolates inputs linearly: give a current with zero-order hold as a function of time.
    """
    import control

    equations = plant.structure.equations
    signals = evaluator(equations, plant.values)
    names = [state.name for state in equations.states]
    contacts = [(c.direction, names.index(c.velocity), WIDTHS[c.name]) for c in plant.structure.system.contacts]

    def update(t: float, x: np.ndarray, u: np.ndarray, params: dict[str, Any]) -> list[float]:
        states = {name: float(value) for name, value in zip(names, x, strict=True)}
        # At rest tanh is 0, which the equations read as sticking; a tiny direction lets the contact move.
        directions = {name: tanh(float(x[i]) / wide) or 1e-300 for name, i, wide in contacts}
        inputs = {name: float(value) for name, value in zip(equations.inputs, u, strict=True)}
        found = signals(**{**params, **states, **directions, **inputs})
        return [found[rate] for rate in equations.rates]

    return control.nlsys(
        update,
        None,
        name=plant.name,
        states=names,
        inputs=list(equations.inputs),
        outputs=names,
        params=plant.values,
    )
