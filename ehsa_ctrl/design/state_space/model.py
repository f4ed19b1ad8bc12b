"""The design model: the sampled linear plant in scaled states, with friction, load and leakage as disturbances.

    x+ = A x + B u + E d,    d+ = d,    y = C x

d are constant disturbances that an observer estimates: a current at the motor (friction, torque constant error), a
force on the rod (load) and a loss of pump speed (leakage). With as many disturbances as measurements, a law that
compensates their estimates has no steady-state error (U. Maeder, F. Borrelli, M. Morari, "Linear offset-free model
predictive control", Automatica 45(10), 2009).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import MEASURED
from ...core.errors import InputError
from ..analysis.sampled import drive_of, readings, scaled_matrices, state_scales

if TYPE_CHECKING:
    import control

#: SI value of a scaled force of 1, so that all disturbances have a similar magnitude.
FORCE_SCALE = 1e3
#: Measured signals in the order of y, each a combination of channels.
SIGNALS: dict[str, dict[str, float]] = {
    "speed": {"speed": 1.0},
    "pressure": {"p1": 1.0, "p2": -1.0},
    "position": {"position": 1.0},
}


@dataclass(frozen=True)
class DesignModel:
    """The sampled plant; a state of 1 is `scale` in SI, inputs and outputs are SI.

    Attributes
    ----------
    A (n, n), B (n,), E (n, d), C (m, n): see above; a disturbance of 1 is `disturbance_scale` [A, N, rad/s].
    scale: (n,) SI value of a state of 1.
    states, signals, disturbances: names; signals are those of SIGNALS that the model's outputs give.
    disturbance_scale: (d,) SI value of a disturbance of 1.
    pick: (m, 5) from the channels MEASURED to y.
    sample_time: s.
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    scale: np.ndarray
    states: tuple[str, ...]
    signals: tuple[str, ...]
    disturbances: tuple[str, ...]
    disturbance_scale: np.ndarray
    pick: np.ndarray
    sample_time: float

    def row(self, signal: str) -> np.ndarray:
        """Row (n,) of a signal [SI] in C. Raises InputError for one that the model lacks."""
        if signal not in self.signals:
            raise InputError(f"the model has no {signal}; it has {', '.join(self.signals)}")
        return self.C[self.signals.index(signal)]

    @property
    def without_disturbance(self) -> DesignModel:
        """The same model without disturbances, for an LQI or a law with steady-state error."""
        return replace(self, E=self.E[:, :0], disturbances=(), disturbance_scale=self.disturbance_scale[:0])


def design_model(system: control.StateSpace, sample_time: float, *, scaled: bool = True) -> DesignModel:
    """Sample the linear model `system` by zero-order hold.

    Parameters
    ----------
    system: continuous; input current, optionally F_D; outputs x, optionally omega and dP (or P_1, P_2).
    scaled: False leaves the states in SI units (for comparison).

    Raises InputError for a sample time that aliases a mode, and for a model that is in discrete time, lacks current or
    position, or is not stabilisable by the current and detectable from the measurements.
    """
    from scipy.signal import cont2discrete

    drive = drive_of(system)
    if not system.isctime() or not drive:
        raise InputError(f"the model {system.name} must be continuous and have the input current; linearise the plant")
    if np.any(readings(system) @ system.D):
        raise InputError(
            f"the model {system.name} has direct feedthrough to a measurement; expected a strictly proper one"
        )
    modes = system.poles()
    fastest = float(np.max(np.abs(modes.imag)))
    if not 0 < sample_time < np.inf or fastest >= np.pi / sample_time:
        raise InputError(
            f"sample_time = {sample_time:g} s does not fit: the model has a mode at {fastest:.4g} rad/s, so that "
            f"sampling needs at most {np.pi / max(fastest, 1e-9):.3g} s not to alias it"
        )
    labels = list(system.state_labels)
    scale = state_scales(system) if scaled else np.ones(len(labels))
    a, inputs, c = scaled_matrices(system, scale)
    b, c = inputs[:, [system.input_labels.index(drive)]], readings(system) @ c
    pick = np.array([[parts.get(channel, 0.0) for channel in MEASURED] for parts in SIGNALS.values()])
    there = np.any(pick @ c != 0.0, axis=1)
    signals = tuple(name for name, seen in zip(SIGNALS, there, strict=True) if seen)
    columns, units = {"friction": b[:, 0]}, {"friction": 1.0}
    if "F_D" in system.input_labels:
        columns["load"] = inputs[:, system.input_labels.index("F_D")] * FORCE_SCALE
        units["load"] = FORCE_SCALE
    if {"omega", "dP"} <= set(labels):
        pump = np.zeros(len(labels))
        pump[labels.index("dP")] = -a[labels.index("dP"), labels.index("omega")] / scale[labels.index("omega")]
        columns["leak"], units["leak"] = pump, 1.0
    # More disturbances than measurements would not be observable.
    disturbances = tuple(columns)[: len(signals)]
    e = np.column_stack([columns[name] for name in disturbances])
    transition, held, *_ = cont2discrete((a, np.hstack([b, e]), np.eye(len(labels)), 0.0), sample_time)
    _require_designable(a, b, (pick @ c)[there], system.name)
    return DesignModel(
        A=transition,
        B=held[:, 0],
        E=held[:, 1:],
        C=(pick @ c)[there],
        scale=scale,
        states=tuple(labels),
        signals=signals,
        disturbances=disturbances,
        disturbance_scale=np.array([units[name] for name in disturbances]),
        pick=pick[there],
        sample_time=sample_time,
    )


def full_rank(matrix: np.ndarray) -> bool:
    """Whether a matrix has full rank, after equilibration of rows and columns in different units (D. Ruiz, "A scaling
    algorithm to equilibrate both rows and columns norms in matrices", 2001)."""
    balanced = np.abs(matrix).astype(float)
    rows, columns = np.ones((matrix.shape[0], 1)), np.ones((1, matrix.shape[1]))
    for _ in range(10):
        by_row = np.sqrt(np.max(balanced, axis=1, keepdims=True))
        by_column = np.sqrt(np.max(balanced, axis=0, keepdims=True))
        rows /= np.where(by_row > 0.0, by_row, 1.0)
        columns /= np.where(by_column > 0.0, by_column, 1.0)
        balanced = np.abs(matrix) * rows * columns
    sizes = np.linalg.svd(matrix * rows * columns, compute_uv=False)
    return bool(sizes[-1] > 1e-9 * sizes[0])


def _require_designable(a: np.ndarray, b: np.ndarray, c: np.ndarray, name: str) -> None:
    """Require stabilisability and detectability: every mode that does not decay is controllable and observable.

    The Popov-Belevitch-Hautus test; without aliasing its outcome for the continuous model holds for the sampled one.
    Unlike analysis.sampled.hidden_modes it equilibrates, because a user's model may have states of any unit.
    """
    fastest = np.max(np.abs(np.linalg.eigvals(a)))
    for mode in np.linalg.eigvals(a):
        if mode.real < -1e-9 * fastest:
            continue
        rest = a - mode * np.eye(len(a))
        if not full_rank(np.hstack([rest, b])):
            fails = "the current does not reach it: no state feedback can stabilise it"
        elif not full_rank(np.vstack([rest, c])):
            fails = "no measurement shows it: no observer can follow it"
        else:
            continue
        raise InputError(f"{name} has a mode at {mode:.4g} rad/s that does not decay and {fails}")
