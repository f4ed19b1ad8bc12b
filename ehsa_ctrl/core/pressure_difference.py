"""Linear models of two chambers: from P_1 and P_2 to the pressure difference dP = P_1 - P_2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import control

#: Share of a row of A that counts as zero; rounding of a linearised model is about 1e-12.
ROUNDING = 1e-9


def has_both_pressures(system: control.StateSpace) -> bool:
    """Whether a model has the states P_1 and P_2, and its states as outputs."""
    names = list(system.state_labels)
    return {"P_1", "P_2"} <= {*names} and names == list(system.output_labels)


def reduce_to_difference(system: control.StateSpace, name: str = "") -> control.StateSpace:
    """From states omega, P_1, P_2, v, x to omega, dP, v, x, as (7) does from (6): without the mode of P_1 + P_2.

    Exact where the equations depend only on the pressure difference (see `level_matters`); with effects on one chamber
    it is the model at constant pressure level. A model without both pressures is returned unchanged.
    """
    import control

    if not has_both_pressures(system):
        return system
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
        inputs=list(system.input_labels),
        outputs=labels,
        name=name or f"{system.name} in dP",
    )


def level_matters(system: control.StateSpace) -> bool:
    """Whether the mean pressure acts on another state of a model with P_1 and P_2."""
    names = list(system.state_labels)
    first, second = names.index("P_1"), names.index("P_2")
    coupled = system.A[:, first] + system.A[:, second]
    coupled[first] = coupled[first] - coupled[second]
    coupled[second] = 0.0
    scale = np.abs(system.A[:, first]) + np.abs(system.A[:, second])
    scale[first] += scale[second]
    return bool(np.any(np.abs(coupled) > ROUNDING * scale))
