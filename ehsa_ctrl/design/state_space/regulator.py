"""The target of states and current for a reference, and the linear quadratic regulator of the error from it.

Target. w = (position, velocity, acceleration, d) obeys w+ = S w with constant acceleration and disturbances d. Then
x = Pi w, u = Gamma w with

    A Pi + B Gamma + [0 E] = Pi S,    c Pi = [1 0 0 0 ...]

follow the reference without lag and steady-state error; these are the regulator equations (B. A. Francis,
W. M. Wonham, "The internal model principle of control theory", Automatica 12(5), 1976).

Regulator. The error xi = x - Pi w, mu = u - Gamma w obeys xi+ = A xi + B mu, and the cost

    sum  xi' Q xi + R mu^2 + R_rate (mu - mu_before)^2 + Q_integral q^2,    q+ = q - T c xi

gives the law mu = -K xi - K_before mu_before - K_integral q. R_rate smooths the current; the integral q replaces the
estimated disturbances in an LQI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ...core.errors import InputError
from .model import DesignModel, full_rank

#: Length of a reference: position, velocity, acceleration.
MOTION = 3


@dataclass(frozen=True)
class Cost:
    """Weights of the cost above.

    Attributes
    ----------
    Q: (n, n), positive semidefinite, on the states of the design model.
    R: 1/A2, greater than 0. R_rate: 1/A2, on the change of the current from sample to sample.
    Q_integral: 1/(m s)2 on the integral of the position error; 0 for none.
    """

    Q: np.ndarray
    R: float
    R_rate: float = 0.0
    Q_integral: float = 0.0

    def require(self, model: DesignModel) -> None:
        """Raises InputError for weights of the wrong shape or sign."""
        n = model.A.shape[0]
        if np.shape(self.Q) != (n, n):
            raise InputError(
                f"the weight Q has the shape {np.shape(self.Q)}; expected ({n}, {n}), one row per state of "
                f"{', '.join(model.states)}"
            )
        sizes = np.linalg.eigvalsh(0.5 * (self.Q + np.transpose(self.Q)))
        if not np.allclose(self.Q, np.transpose(self.Q)) or np.min(sizes) < -1e-9 * max(np.max(sizes), 1e-300):
            raise InputError("the weight Q must be symmetric and positive semidefinite")
        if not (0 < self.R < np.inf and 0 <= self.R_rate < np.inf and 0 <= self.Q_integral < np.inf):
            raise InputError(
                f"weights R = {self.R:g}, R_rate = {self.R_rate:g}, Q_integral = {self.Q_integral:g}; expected R > 0 "
                "and the others at least 0"
            )


def weight_matrix(model: DesignModel, deviations: dict[str, float]) -> np.ndarray:
    """Q from deviations that cost 1 each: signal (speed, pressure, position) -> SI value (A. E. Bryson, Y.-C. Ho,
    "Applied Optimal Control", section 5.2)."""
    n = model.A.shape[0]
    return sum((np.outer(model.row(s), model.row(s)) / size**2 for s, size in deviations.items()), np.zeros((n, n)))


def positive_root(matrix: np.ndarray) -> np.ndarray:
    """Root with root @ root.T = matrix of a positive semidefinite matrix, without its rounding errors below zero."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True)
class Regulator:
    """Gains of the regulator, and the problem that they solve.

    Attributes
    ----------
    K: (n,) A per state. before: A/A. integral: A/(m s).
    P: (n + 1, n + 1) cost-to-go of (xi, mu_before), a terminal cost; with an integral (n + 2, n + 2).
    A (N, N), B (N,), Q (N, N), N_cross (N,), R: the problem, states (xi, mu_before, q).
    """

    K: np.ndarray
    before: float
    integral: float
    P: np.ndarray
    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    N_cross: np.ndarray
    R: float

    @property
    def poles(self) -> np.ndarray:
        """Poles (N,) of the closed loop with known states, in z; one at 0 belongs to mu_before."""
        gains = np.r_[self.K, self.before, [self.integral] * (len(self.A) - len(self.K) - 1)]
        return np.linalg.eigvals(self.A - np.outer(self.B, gains))


def design_regulator(model: DesignModel, cost: Cost) -> Regulator:
    """The regulator for a design model and a cost, by python-control's `dlqr`.

    Raises InputError for weights of the wrong shape or sign, and for weights that leave a mode undamped.
    """
    import control

    cost.require(model)
    n, whole = model.A.shape[0], model.A.shape[0] + 1 + (cost.Q_integral > 0)
    a, b, Q, cross = np.zeros((whole, whole)), np.zeros(whole), np.zeros((whole, whole)), np.zeros(whole)
    a[:n, :n], b[:n], b[n] = model.A, model.B, 1.0
    Q[:n, :n], Q[n, n], cross[n] = cost.Q, cost.R_rate, -cost.R_rate
    if cost.Q_integral > 0:
        a[n + 1, :n], a[n + 1, n + 1] = -model.sample_time * model.row("position"), 1.0
        Q[n + 1, n + 1] = cost.Q_integral
    R = cost.R + cost.R_rate
    try:
        gains, P, poles = control.dlqr(a, b[:, None], Q, np.array([[R]]), cross[:, None], method="scipy")
    except (np.linalg.LinAlgError, control.ControlArgument) as error:
        raise InputError(
            f"these weights give no regulator ({error}): every mode that does not decay needs a weight; "
            "give [weights] position"
        ) from None
    if np.max(np.abs(poles)) >= 1.0:
        raise InputError("these weights give an unstable loop: give [weights] position")
    K = np.asarray(gains)[0]
    return Regulator(K[:n], float(K[n]), float(K[n + 1]) if whole > n + 1 else 0.0, P, a, b, Q, cross, R)


@dataclass(frozen=True)
class Target:
    """Solution Pi (n, 3 + d), Gamma (3 + d,) of the regulator equations above, and S (3 + d, 3 + d)."""

    Pi: np.ndarray
    Gamma: np.ndarray
    S: np.ndarray


def solve_target(model: DesignModel) -> Target:
    """Solve the regulator equations of a design model for its position.

    Raises InputError for a plant with a zero at z = 1, whose position the current can't hold or move steadily.
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
    # Equations in m and in scaled states differ in size; equal rows keep the digits.
    rows = np.max(np.abs(both), axis=1)
    solution = np.linalg.solve(both / rows[:, None], right / rows)
    return Target(solution[: n * k].reshape(k, n).T, solution[n * k :], S)
