"""A linear model in contact with an elastic environment, for the design and analysis of force controllers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError

if TYPE_CHECKING:
    import control

#: Output of a model that is the force in the load cell [N].
FORCE = "force"


def in_contact(system: control.StateSpace, stiffness: float) -> control.StateSpace:
    """The model with F_D = stiffness x, a spring [N/m] between rod and ground, and its force as an output "force".

    Raises InputError for a model without the input F_D or the output x.
    """
    import control

    if "F_D" not in system.input_labels or "x" not in system.output_labels:
        raise InputError(f"the model {system.name} has no input F_D or no output x; a force controller needs both")
    force = stiffness * system.C[[system.output_labels.index("x")]]
    load = system.B[:, [system.input_labels.index("F_D")]]
    return control.ss(
        system.A + load @ force,
        system.B,
        np.vstack([system.C, force]),
        0,
        states=system.state_labels,
        inputs=system.input_labels,
        outputs=[*system.output_labels, FORCE],
        name=f"{system.name} against {stiffness:.0f} N/m",
    )


def loop_model(system: control.StateSpace, controller: Any) -> control.StateSpace:
    """The model on which a controller's loop is closed.

    In contact with the environment of its design for a controller that follows a force, the model itself for any other
    and for a model that has the output "force".
    """
    stiffness = getattr(getattr(controller, "law", controller), "stiffness", None)
    return system if stiffness is None or FORCE in system.output_labels else in_contact(system, stiffness)
