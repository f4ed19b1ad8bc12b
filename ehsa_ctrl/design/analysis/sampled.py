"""The linear plant as a controller meets it: sampled, behind its hold, with its measurements by channel."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.errors import InputError
from ...core.protocol import MEASURED
from .reachable import without_constants

if TYPE_CHECKING:
    import control

#: Most samples by which a current may be late: each is a state.
LATEST = 100
#: What a state is divided by: rad/s, Pa and m differ by ten decades, which no Riccati equation and no solver likes.
SCALES = {"omega": 100.0, "dP": 1e6, "P_1": 1e6, "P_2": 1e6, "v": 0.1, "x": 0.01}
#: Channel -> how it follows from a model's outputs; the first row whose outputs the model has is taken.
READINGS: dict[str, tuple[dict[str, float], ...]] = {
    "speed": ({"omega": 1.0},),
    # (7) knows the pressures as deviations of their difference alone: P_1 - P_2 = dP.
    "p1": ({"P_1": 1.0}, {"dP": 0.5}),
    "p2": ({"P_2": 1.0}, {"dP": -0.5}),
    "position": ({"x": 1.0},),
    "force": ({"force": 1.0},),
}


def readings(system: control.StateSpace) -> np.ndarray:
    """Matrix (5, outputs) from a model's outputs to the channels of core.protocol.MEASURED; zeros for what it lacks.

    Raises InputError for a model without a position x.
    """
    names = list(system.output_labels)
    if "x" not in names:
        raise InputError(f"the model {system.name} has no output x; expected a model with the rod's position")
    matrix = np.zeros((len(MEASURED), len(names)))
    for row, channel in enumerate(MEASURED):
        for parts in READINGS[channel]:
            if set(parts) <= set(names):
                for name, weight in parts.items():
                    matrix[row, names.index(name)] = weight
                break
    return matrix


class Scaled(NamedTuple):
    """A continuous model for sampling: x' = a x + inputs (current, force), readings = c x, in states of like size."""

    a: np.ndarray
    inputs: np.ndarray
    c: np.ndarray


def sizes(system: control.StateSpace) -> np.ndarray:
    """SI value (n,) of each state that is as large as 1 of another, by SCALES; 1 for a state of another name.

    Not by balancing the matrix: where a linearised model has 1e-10 from rounding instead of 0, that takes the position
    for a state that hardly moves.
    """
    return np.array([SCALES.get(name, 1.0) for name in system.state_labels])


def scaled(system: control.StateSpace) -> Scaled:
    """A model with the current and the force as inputs and the five channels as outputs, see `sampled_plant`."""
    if not system.isctime():
        raise InputError(f"the model {system.name} is in discrete time; expected the continuous linear model")
    if "current" not in system.input_labels:
        raise InputError(f"the model {system.name} has the inputs {', '.join(system.input_labels)}; expected current")
    if np.any(system.D):
        raise InputError(f"the model {system.name} has outputs that follow an input at once; expected none")
    scale = sizes(system)
    inputs = np.zeros((system.nstates, 2))
    for column, name in enumerate(("current", "F_D")):
        if name in system.input_labels:
            inputs[:, column] = system.B[:, system.input_labels.index(name)] / scale
    a = system.A * (scale[None, :] / scale[:, None])
    return Scaled(*without_constants(a, inputs, readings(system) @ system.C * scale[None, :]))


def sampled(model: Scaled, sample_time: float, delay: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices A, B, C of the sampled plant whose current acts `delay` [s] late, see `sampled_plant`."""
    from scipy.linalg import block_diag, expm

    a, inputs, c = model
    n = a.shape[0]

    def held(duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Transition (n, n) and what held inputs do (n, 2) over a duration."""
        exponent = np.zeros((n + 2, n + 2))
        exponent[:n, :n], exponent[:n, n:] = a, inputs
        moved = expm(exponent * duration)
        return moved[:n, :n], moved[:n, n:]

    transition, both = held(sample_time)
    if delay <= 1e-9 * sample_time:
        return transition, both, c
    whole = int(np.floor(delay / sample_time + 1e-12))
    late = max(delay - whole * sample_time, 0.0)
    rest, new = held(sample_time - late)
    # Behind the plant's states a line of currents, the newest first: u[k-1], u[k-2] ... u[k-whole-1].
    line = whole + 1
    A, B = block_diag(transition, np.eye(line, k=-1)), np.zeros((n + line, 2))
    A[:n, n + line - 1] = rest @ held(late)[1][:, 0]
    if whole == 0:
        B[:n, 0] = new[:, 0]
    else:
        A[:n, n + line - 2] += new[:, 0]
    B[:n, 1], B[n, 0] = both[:, 1], 1.0
    return A, B, np.hstack([c, np.zeros((c.shape[0], line))])


def sampled_plant(system: control.StateSpace, sample_time: float, *, delay: float = 0.0) -> control.StateSpace:
    """A continuous linear plant as discrete state space, exact at the samples.

    Current and force are held over each sample (zero-order hold); the current acts `delay` [s] late, any fraction of a
    sample (K. J. Astrom, B. Wittenmark, "Computer-Controlled Systems", 3rd ed. 1997, section 2.3: with the delay
    d h + tau, the held current of two samples acts within each, the old one for tau).

    Parameters
    ----------
    system: inputs current and, where there is one, F_D; outputs by name (omega, dP or P_1 and P_2, x).

    Returns
    -------
    inputs current, F_D; outputs MEASURED in this order; the states are scaled, and what no input ever changes
    (P_1 + P_2 in (6)) is left out.

    Raises InputError for a model in discrete time, with feedthrough, or without the input current or the output x.
    """
    import control

    if not (0 < sample_time < np.inf and 0 <= delay <= LATEST * sample_time):
        raise InputError(
            f"sample time {sample_time:g} s, delay {delay:g} s; expected more than zero, and zero to {LATEST} samples"
        )
    matrices = sampled(scaled(system), sample_time, delay)
    return control.ss(
        *matrices, 0, sample_time, inputs=["current", "F_D"], outputs=list(MEASURED), name=f"{system.name}, sampled"
    )
