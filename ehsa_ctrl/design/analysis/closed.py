"""A sampled plant with a sampled law around it, as one discrete system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from ...core.protocol import MEASURED, REFERENCE

if TYPE_CHECKING:
    import control

#: What comes into a closed loop: the reference, noise on each reading, the force on the rod, an extra current.
INPUTS = (*(f"r_{name}" for name in REFERENCE), *(f"n_{name}" for name in MEASURED), "F_D", "extra")
#: What is seen of it: the plant's readings without noise, and the current that the law asks for.
OUTPUTS = (*MEASURED, "current")


def law_of(controller: Any) -> control.StateSpace:
    """The controller's linear law without the states that no reading reaches or that never reach its current.

    An integrator with a gain of zero would else stand as a pole on the unit circle in every closed loop. Only what is
    unconnected by structure goes, so that nothing hangs on a tolerance.

    Raises InputError for a controller without a linear law, or one of another shape.
    """
    import control

    if not hasattr(controller, "linear"):
        raise InputError(f"controller {controller.name} has no linear law to analyse")
    law = control.ss(controller.linear())
    if (law.ninputs, law.noutputs) != (len(REFERENCE) + len(MEASURED), 1):
        raise InputError(
            f"the linear law of {controller.name} has {law.ninputs} inputs and {law.noutputs} outputs; expected "
            f"{len(REFERENCE) + len(MEASURED)}, {', '.join((*REFERENCE, *MEASURED))}, and the current"
        )
    if not np.isclose(law.dt, controller.sample_time, rtol=1e-9) or law.isctime():
        raise InputError(
            f"the linear law of {controller.name} has dt = {law.dt}; expected its sample time, "
            f"{controller.sample_time:g} s"
        )
    edges = law.A != 0.0
    driven, heard = np.any(law.B != 0.0, axis=1), np.any(law.C != 0.0, axis=0)
    for _ in range(law.nstates):
        driven, heard = driven | (edges @ driven), heard | (edges.T @ heard)
    kept = np.flatnonzero(driven & heard)
    return control.ss(law.A[np.ix_(kept, kept)], law.B[kept], law.C[:, kept], law.D, controller.sample_time)


def closed_matrix(a: np.ndarray, b: np.ndarray, c: np.ndarray, law: control.StateSpace) -> np.ndarray:
    """A of the closed loop, from the sampled plant's A, B (current first) and C: what its poles are of."""
    push, k_y, d_y = b[:, :1], law.B[:, len(REFERENCE) :], law.D[:, len(REFERENCE) :]
    return np.block([[a + push @ d_y @ c, push @ law.C], [k_y @ c, law.A]])


def closed_loop(plant: control.StateSpace, law: control.StateSpace) -> control.StateSpace:
    """The loop closed: current = law(reference, readings + noise) + extra, inputs INPUTS, outputs OUTPUTS.

    Parameters
    ----------
    plant: as `sampled_plant` gives it. law: as `law_of` gives it.
    """
    import control

    references = len(REFERENCE)
    k_r, k_y = law.B[:, :references], law.B[:, references:]
    d_r, d_y = law.D[:, :references], law.D[:, references:]
    push, force = plant.B[:, :1], plant.B[:, 1:]
    a = closed_matrix(plant.A, plant.B, plant.C, law)
    b = np.block(
        [
            [push @ d_r, push @ d_y, force, push],
            [k_r, k_y, np.zeros((law.nstates, 2))],
        ]
    )
    c = np.block([[plant.C, np.zeros((len(MEASURED), law.nstates))], [d_y @ plant.C, law.C]])
    d = np.zeros((len(OUTPUTS), len(INPUTS)))
    d[-1, : law.ninputs] = law.D[0]
    return control.ss(a, b, c, d, plant.dt, inputs=list(INPUTS), outputs=list(OUTPUTS))
