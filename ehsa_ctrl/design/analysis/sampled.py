"""The sampled linear plant: zero-order hold, input delay, outputs by measured channel."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.controller_interface import MEASURED
from ...core.errors import InputError

if TYPE_CHECKING:
    import control

#: Inputs that are a drive: the current, or the force of a carriage, which takes its place everywhere.
#: With its SI unit.
DRIVES = {"current": "A", "F_M": "N"}
#: Longest delay of the current [samples]: each sample adds a state.
LATEST = 100
#: Typical magnitude of each state [SI]: rad/s, Pa and m differ by ten decades, too much for Riccati and QP solvers.
SCALES = {"omega": 100.0, "dP": 1e6, "P_1": 1e6, "P_2": 1e6, "v": 0.1, "x": 0.01}
#: Channel -> expressions in the model's outputs; the first one whose outputs the model has applies.
READINGS: dict[str, tuple[dict[str, float], ...]] = {
    "speed": ({"omega": 1.0},),
    # (7) has only the pressure difference dP = P_1 - P_2.
    "p1": ({"P_1": 1.0}, {"dP": 0.5}),
    "p2": ({"P_2": 1.0}, {"dP": -0.5}),
    "position": ({"x": 1.0},),
    "force": ({"force": 1.0},),
}
#: Relative singular value below which a matrix is rank-deficient: well above rounding of a model in scaled states.
RANK_TOLERANCE = 1e-9


def readings(system: control.StateSpace) -> np.ndarray:
    """Matrix (5, outputs) from a model's outputs to the channels MEASURED; zeros for channels that it lacks.

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


def state_scales(system: control.StateSpace) -> np.ndarray:
    """Scale (n,) of each state by its name, see SCALES; 1 for other names, and balanced where none is known.

    Matrix balancing of a known model would fail: a linearised one has entries of 1e-10 instead of 0 from rounding, and
    balancing would take them for real couplings of the position.
    """
    if not set(system.state_labels) & set(SCALES):
        # A model of somebody else's, whose states may be of any size: in SI units they differ by ten decades.
        from scipy.linalg import matrix_balance

        _, (scale, _) = matrix_balance(np.asarray(system.A, dtype=float), permute=False, separate=True)
        return np.asarray(scale)
    return np.array([SCALES.get(name, 1.0) for name in system.state_labels])


def scaled_matrices(system: control.StateSpace, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and C of a system for states in units of `scale` (n,)."""
    return system.A * (scale[None, :] / scale[:, None]), system.B / scale[:, None], system.C * scale[None, :]


class ScaledModel(NamedTuple):
    """A continuous model in scaled states: x' = a x + inputs (current, force), readings = c x."""

    a: np.ndarray
    inputs: np.ndarray
    c: np.ndarray


def drive_of(system: control.StateSpace) -> str:
    """Name of the input of a model that is its drive; empty for one without."""
    return next((name for name in DRIVES if name in system.input_labels), "")


def drive_unit_of(system: control.StateSpace) -> str:
    """SI unit of a model's drive; A for a model without one."""
    return DRIVES.get(drive_of(system), "A")


def scale_model(system: control.StateSpace) -> ScaledModel:
    """The model with inputs current and force and the five channels as outputs; errors as `sampled_plant`."""
    if not system.isctime():
        raise InputError(f"the model {system.name} is in discrete time; expected the continuous linear model")
    drive = drive_of(system)
    if not drive:
        raise InputError(f"the model {system.name} has the inputs {', '.join(system.input_labels)}; expected current")
    if np.any(system.D):
        raise InputError(f"the model {system.name} has direct feedthrough; expected none")
    a, b, c = scaled_matrices(system, state_scales(system))
    inputs = np.zeros((system.nstates, 2))
    for column, name in enumerate((drive, "F_D")):
        if name in system.input_labels:
            inputs[:, column] = b[:, system.input_labels.index(name)]
    return ScaledModel(*remove_constant_states(a, inputs, readings(system) @ c))


def sample(model: ScaledModel, sample_time: float, delay: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices A, B, C of the sampled plant with a delay [s] of the current, see `sampled_plant`."""
    from scipy.linalg import block_diag, expm

    a, inputs, c = model
    n = a.shape[0]

    def hold(duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Transition (n, n) and effect of held inputs (n, 2) over a duration."""
        exponent = np.zeros((n + 2, n + 2))
        exponent[:n, :n], exponent[:n, n:] = a, inputs
        moved = expm(exponent * duration)
        return moved[:n, :n], moved[:n, n:]

    transition, both = hold(sample_time)
    if delay <= 1e-9 * sample_time:
        return transition, both, c
    whole = int(np.floor(delay / sample_time + 1e-12))
    late = max(delay - whole * sample_time, 0.0)
    rest, new = hold(sample_time - late)
    # The delay line follows the plant's states, newest current first: u[k-1], u[k-2] ... u[k-whole-1].
    line = whole + 1
    A, B = block_diag(transition, np.eye(line, k=-1)), np.zeros((n + line, 2))
    A[:n, n + line - 1] = rest @ hold(late)[1][:, 0]
    if whole == 0:
        B[:n, 0] = new[:, 0]
    else:
        A[:n, n + line - 2] += new[:, 0]
    B[:n, 1], B[n, 0] = both[:, 1], 1.0
    return A, B, np.hstack([c, np.zeros((c.shape[0], line))])


def sampled_plant(system: control.StateSpace, sample_time: float, *, delay: float = 0.0) -> control.StateSpace:
    """A continuous linear plant as discrete state space, exact at the samples.

    Current and force are held over each sample (zero-order hold); the current acts `delay` [s] late, any fraction of a
    sample. python-control's sample_system has no fractional delays: the matrices follow K. J. Astrom, B. Wittenmark,
    "Computer-Controlled Systems", 3rd ed. 1997, section 2.3.

    Parameters
    ----------
    system: inputs current and, optionally, F_D; outputs by name (omega, dP or P_1 and P_2, x).

    Returns
    -------
    inputs current, F_D; outputs MEASURED in this order; scaled states, without combinations that no input ever
    changes (P_1 + P_2 in (6)).

    Raises InputError for a model in discrete time, with feedthrough, or without the input current or the output x.
    """
    import control

    if not (0 < sample_time < np.inf and 0 <= delay <= LATEST * sample_time):
        raise InputError(
            f"sample time {sample_time:g} s, delay {delay:g} s; expected more than zero, and zero to {LATEST} samples"
        )
    matrices = sample(scale_model(system), sample_time, delay)
    return control.ss(
        *matrices, 0, sample_time, inputs=["current", "F_D"], outputs=list(MEASURED), name=f"{system.name}, sampled"
    )


def remove_constant_states(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Remove the combinations of states that no input changes, as P_1 + P_2 in (6), from a (n, n), b (n, m), c (p, n).

    If w' A = 0 and w' B = 0, w' x is constant; deviations from rest start at 0, so that x stays in the plane w' x = 0.
    """
    left, values, _ = np.linalg.svd(np.hstack([a / _norm(a), _unit_columns(b)]))
    constant = values < RANK_TOLERANCE
    if not constant.any():
        return a, b, c
    plane = left[:, ~constant]
    return plane.T @ a @ plane, plane.T @ b, c @ plane


def hidden_modes(a: np.ndarray, b: np.ndarray) -> list[complex]:
    """Uncontrollable eigenvalues [rad/s] by the Popov-Belevitch-Hautus test; of (A', C'), the unobservable ones.

    a (n, n), b (n, m): in scaled states.
    """
    size = _norm(a)
    found: list[complex] = []
    for eigenvalue in np.linalg.eigvals(a):
        mode = complex(eigenvalue) if abs(eigenvalue) > RANK_TOLERANCE * size else 0j
        pencil = np.hstack([(mode * np.eye(a.shape[0]) - a) / size, _unit_columns(b)])
        lost = int(np.count_nonzero(np.linalg.svd(pencil, compute_uv=False) < RANK_TOLERANCE))
        # Of a multiple eigenvalue some may be controllable: count each hidden one once.
        if sum(abs(mode - known) <= RANK_TOLERANCE * size for known in found) < lost:
            found.append(mode)
    return found


def _norm(a: np.ndarray) -> float:
    return max(float(np.linalg.norm(a, 2)), 1e-300)


def _unit_columns(b: np.ndarray) -> np.ndarray:
    """Columns scaled to length 1, without zero columns."""
    lengths = np.linalg.norm(b, axis=0)
    return b[:, lengths > 0] / lengths[lengths > 0]
