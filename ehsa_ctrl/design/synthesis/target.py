"""Where the states must be for the position to follow its reference, and the current that keeps them there.

The reference (position, velocity, acceleration) and the disturbances d are taken for the outputs of
w+ = S w, the acceleration and the disturbances standing still. Then x = Pi w, u = Gamma w with

    A Pi + B Gamma + [0 E] = Pi S,    c Pi = [1 0 0 0 ...]

follow it without lag and without standing error (B. A. Francis, W. M. Wonham, "The internal model principle of control
theory", Automatica 12(5), 1976; the equations are known as the regulator equations).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ...core.errors import InputError
from .model import DesignModel, full_rank

#: Numbers of a reference: position, velocity, acceleration.
MOTION = 3


@dataclass(frozen=True)
class Target:
    """Pi (n, 3 + d), Gamma (3 + d,) and S (3 + d, 3 + d) of the text above."""

    Pi: np.ndarray
    Gamma: np.ndarray
    S: np.ndarray


def target(model: DesignModel) -> Target:
    """Solve the regulator equations of a design model for its position.

    Raises InputError for a plant whose position can't be held or moved steadily by the current (a zero at z = 1).
    """
    n, d, T = model.A.shape[0], model.E.shape[1], model.sample_time
    c = model.row("position")
    motion = np.array([[1.0, T, 0.5 * T * T], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    S = block_diag(motion, np.eye(d)) if d else motion
    k = MOTION + d
    driven = np.hstack([np.zeros((n, MOTION)), model.E])
    wanted = np.eye(1, k)
    # vec(A Pi - Pi S + B Gamma) = -vec([0 E]) and vec(c Pi) = vec(wanted), columns stacked.
    both = np.block(
        [
            [np.kron(np.eye(k), model.A) - np.kron(S.T, np.eye(n)), np.kron(np.eye(k), model.B[:, None])],
            [np.kron(np.eye(k), c[None, :]), np.zeros((k, k))],
        ]
    )
    right = np.concatenate([-driven.T.ravel(), wanted.ravel()])
    if not full_rank(both):
        raise InputError("the current can't hold or move the position steadily: the plant has a zero at z = 1")
    # Positions in m stand beside states of 1: rows of like size keep the digits.
    rows = np.max(np.abs(both), axis=1)
    solution = np.linalg.solve(both / rows[:, None], right / rows)
    return Target(solution[: n * k].reshape(k, n).T, solution[n * k :], S)
