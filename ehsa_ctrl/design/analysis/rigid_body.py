"""The rigid body that a positioning drive is below its hydraulic or structural modes.

    dv/dt = b_0 u - c v + disturbance,    v = n omega

Laws that know no more of the plant than this are designed from it: active disturbance rejection, sliding mode.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import MEASURED
from ...core.errors import InputError
from .closed_loop import transfer
from .sampled import scale_model

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class RigidBody:
    """b_0: acceleration per current [m/(s2 A)]. c: decay rate of the velocity [1/s]. n: travel per radian of the shaft
    [m], 0 for a model without the shaft's speed."""

    b_0: float
    c: float
    n: float


def rigid_body(system: control.StateSpace, omega: float) -> RigidBody:
    """The rigid body with the model's response from current to velocity V at `omega` [rad/s]: (i w + c) / b_0 = 1 / V.

    system: continuous, as `sampled_plant` takes it. The column of the current alone counts.

    Raises InputError where the model does not accelerate with the current at this frequency.
    """
    a, inputs, c = scale_model(system)
    s = 1j * omega
    response = transfer(a, inputs[:, :1], c, np.array([s]))[0, :, 0]
    position, speed = response[MEASURED.index("position")], response[MEASURED.index("speed")]
    inverse = 1.0 / (s * position) if position != 0.0 else 0j
    if not inverse.imag > 0.0:
        raise InputError(
            f"the model {system.name} does not accelerate with the current at {omega:.4g} rad/s; lower the bandwidth, "
            "or give b_0"
        )
    b_0 = omega / inverse.imag
    n = float(abs(s * position / speed)) if speed != 0.0 else 0.0
    return RigidBody(float(b_0), float(b_0 * inverse.real), n)
