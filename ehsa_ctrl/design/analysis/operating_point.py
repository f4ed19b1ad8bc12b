"""The linear model of a rod at another operating point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import InputError

if TYPE_CHECKING:
    import control

#: States whose rates are proportional to the bulk modulus.
PRESSURES = ("dP", "P_1", "P_2")


def operating_point(
    system: control.StateSpace, *, stiffness: float = 0.0, mass: float = 0.0, bulk_modulus: float = 1.0
) -> control.StateSpace:
    """The model with `stiffness` [N/m] and `mass` [kg] added to the load, and another bulk modulus.

    The column of input F_D is the effect of a force on the rod, so that no plant is needed.

    Parameters
    ----------
    system: continuous, states v and x, input F_D, and a pressure for another bulk modulus, as three_state(plant)
        returns it.
    bulk_modulus: factor on the oil's bulk modulus.

    Raises InputError for a model without these states and this input.
    """
    import control

    states, inputs = list(system.state_labels), list(system.input_labels)
    pressures = [states.index(name) for name in PRESSURES if name in states]
    oil = bulk_modulus != 1.0
    if not {"v", "x"} <= set(states) or "F_D" not in inputs or (oil and not pressures):
        raise InputError(
            f"the model {system.name} has the states {', '.join(states)} and inputs {', '.join(inputs)}; another "
            f"operating point needs v, x and F_D{', and another bulk_modulus a pressure' if oil else ''}"
        )
    a, b = np.array(system.A, dtype=float), np.array(system.B, dtype=float)
    v, force = states.index("v"), inputs.index("F_D")
    a[:, states.index("x")] += stiffness * b[:, force]
    share = 1.0 / (1.0 - mass * b[v, force])
    a[v] *= share
    b[v] *= share
    a[pressures] *= bulk_modulus
    b[pressures] *= bulk_modulus
    return control.ss(
        a, b, system.C, system.D, states=states, inputs=inputs, outputs=list(system.output_labels), name=system.name
    )
